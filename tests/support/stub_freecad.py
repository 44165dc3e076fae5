"""As much of FreeCAD as a post-processor sees, in both of its shapes, and a ph-post that leaves its traces.

What the stubs do is read off FreeCAD's sources: of 0.20.2 PathScripts/PathPost.py and PathPostProcessor.py,
of 1.x Path/Post/Processor.py, Command.py and PostList.py.
"""

from __future__ import annotations

import importlib.util
import sys
from dataclasses import dataclass, field
from pathlib import Path
from types import ModuleType, SimpleNamespace

POST = Path(__file__).parents[2] / "ph_post" / "data" / "freecad" / "backlash_post.py"

FAKE = """
import json, os, sys
from pathlib import Path
here = Path(sys.argv[0]).parent
words, text = sys.argv[1:], sys.stdin.read()
with (here / "calls.jsonl").open("a") as calls:
    calls.write(json.dumps({"words": words, "text": text, "leaked": "PYTHONHOME" in os.environ}) + "\\n")
if (here / "refusal").exists() and words[0] == "convert":
    sys.stderr.write("ph-post: reading (1 s) ...\\n" + (here / "refusal").read_text())
    sys.exit(2)
if words[0] == "freecad":
    sys.stdout.write((here / "answer.json").read_text())
else:
    sys.stderr.write("stdin: 2 stops\\nwarning: mind the gap\\n")
    sys.stdout.write("(compensated)\\n" + text)
"""


class Command:
    """A Path.Command."""

    def __init__(self, name, parameters=None):
        self.Name, self.Parameters = name, dict(parameters or {})


class Toolpath:
    """A Path.Path."""

    def __init__(self, commands=()):
        self.Commands = list(commands)


@dataclass
class Postable:
    """What the newest FreeCAD hands to post-processors in place of the document's objects."""

    item_type: str
    label: str
    path: Toolpath
    source: object
    data: dict = field(default_factory=dict)

    @property
    def Path(self):
        return self.path

    @property
    def Label(self):
        return self.label

    def __getattr__(self, name):
        if name.startswith("__") or self.__dict__.get("source") is None:
            raise AttributeError(name)
        return getattr(self.source, name)


class Console:
    """FreeCAD's report view."""

    def __init__(self):
        self.messages, self.warnings = [], []

    def PrintMessage(self, text):
        self.messages.append(text)

    def PrintWarning(self, text):
        self.warnings.append(text)


def written(things, arguments):
    """A program as an inner post-processor writes it, F in mm/min."""
    lines = [f"({arguments})"]
    for thing in things:
        lines.append(f"(begin {thing.Label})")
        for command in thing.Path.Commands:
            words = {k: v * 60.0 if k == "F" else v for k, v in command.Parameters.items()}
            lines.append(" ".join([command.Name, *(f"{k}{v:.3f}" for k, v in words.items())]))
    return "\n".join(lines) + "\n"


class Script:
    """A post-processor of FreeCAD 0.20 as its loader gives it."""

    units = "Metric"

    def __init__(self, name):
        self.name = name
        self.tooltipArgs = "usage: [--no-header] [--no-show-editor] [--precision PRECISION] [--axis-modal]"

    def export(self, things, filename, arguments):
        if "--preamble" in arguments:
            sys.stderr.write("usage: linuxcnc\nlinuxcnc: error: argument --preamble: expected one argument\n")
            raise SystemExit(2)
        if self.name == "mute":
            return None
        text = written(things, f"{self.name} {arguments}")
        Path(filename).write_text(text)
        return text if self.name == "linuxcnc" else None  # that for Grbl returns nothing


class Loader:
    """FreeCAD 0.20's PostProcessor."""

    @classmethod
    def exists(cls, name):
        return name in ("linuxcnc", "grbl", "mute")

    @classmethod
    def load(cls, name):
        return Script(name)


class PostProcessor:
    """FreeCAD 1.x's base class: as much of it as derived ones rely on."""

    def __init__(self, job, tooltip, tooltipargs, units, *args, **kwargs):
        self._job = job["job"] if isinstance(job, dict) else job
        self._operations = job["operations"] if isinstance(job, dict) else []
        self._machine = getattr(self._job, "Machine", None)
        self._units, self.values, self.cancelled = units, {}, False

    @classmethod
    def get_common_property_schema(cls):
        return [{"name": "preamble", "default": ""}]

    @classmethod
    def get_property_schema(cls):
        return []

    @classmethod
    def get_full_property_schema(cls):
        return cls.get_common_property_schema() + cls.get_property_schema()

    def _buildPostList(self):
        return [(name, list(items)) for name, items in self._job.sections]

    def pre_processing_dialog(self):
        return not self.cancelled

    def apply_configuration_bundle(self):
        for one in self.get_full_property_schema():
            self._machine.postprocessor_properties.setdefault(one["name"], one.get("default", ""))
        self.values["FILE_EXTENSION"] = "nc"


class Linuxcnc(PostProcessor):
    """FreeCAD's own for LinuxCNC, in its new shape."""

    def __init__(self, job):
        super().__init__(job, "", "", "Metric")
        self.tooltipArgs = Script("linuxcnc").tooltipArgs

    @classmethod
    def get_common_property_schema(cls):
        return [{"name": "preamble", "default": "G17 G90"}]

    def export(self):
        arguments = f"linuxcnc {self._job.PostProcessorArgs}"
        return [(name, written(items, arguments)) for name, items in self._buildPostList()]

    def export2(self):
        properties = self._machine.postprocessor_properties
        return [(name, written(items, properties["preamble"])) for name, items in self._buildPostList()]


class Grbl(Linuxcnc):
    """FreeCAD's own for Grbl."""

    @classmethod
    def get_common_property_schema(cls):
        return [{"name": "preamble", "default": "G90 G21"}]


class WrapperPost(PostProcessor):
    """An old script in FreeCAD 1.x: its help is not what `tooltipArgs` shows."""

    def __init__(self, job):
        super().__init__(job, "", "", "Metric")
        self.tooltipArgs, self._tooltipargs = "[--metric]", "[--no-tlo]"

    def export(self):
        return [(name, written(items, self._job.PostProcessorArgs)) for name, items in self._buildPostList()]


class PostProcessorFactory:
    """What makes post-processors by their names."""

    @staticmethod
    def get_post_processor(job, name):
        known = {"linuxcnc": Linuxcnc, "grbl": Grbl, "script": WrapperPost}
        return known[name](job) if name in known else None


def load_post(monkeypatch, version):
    """Load the post-processor into a stub of FreeCAD "0.20" or "1.x"; return it and the report view."""
    console = Console()
    path = ModuleType("Path")
    path.Command, path.Path = Command, Toolpath
    modules = {"FreeCAD": SimpleNamespace(Console=console, GuiUp=False), "Path": path}
    if version == "0.20":
        old = ModuleType("PathScripts.PathPostProcessor")
        old.PostProcessor = Loader
        modules |= {"PathScripts": ModuleType("PathScripts"), "PathScripts.PathPostProcessor": old}
    else:
        path.__path__ = []
        post, new = ModuleType("Path.Post"), ModuleType("Path.Post.Processor")
        post.__path__ = []
        new.PostProcessor, new.PostProcessorFactory = PostProcessor, PostProcessorFactory
        modules |= {"Path.Post": post, "Path.Post.Processor": new}
    for name, module in modules.items():
        monkeypatch.setitem(sys.modules, name, module)
    spec = importlib.util.spec_from_file_location("backlash_post", POST)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module, console
