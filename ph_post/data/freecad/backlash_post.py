"""FreeCAD post-processor: a job posted by FreeCAD's own post-processor, with backlash compensated by ph-post.

`ph-post freecad --install` copies this file to where FreeCAD looks for post-processors. It runs in FreeCAD's
Python, from 3.8 on, and needs nothing but that: ph-post itself is started as a program.

A job's objects go to the post-processor of the machine's dialect that FreeCAD ships (or `--post=NAME`), so
that tool changes, spindle, coolant, cycles, work offsets and comments are what they always were. Before that,
straight moves that FreeCAD sampled from a spline of the operation's geometry become splines (G5), where the
controller can play them; arcs are arcs anyway. Afterwards `ph-post convert` compensates the program, verifies
the outcome and gives it back. Nothing is written where anything fails.

FreeCAD 0.20 and 0.21 call `export`; FreeCAD 1.x makes a `Backlash`, and calls `export()`, or `export2()` for
jobs with a machine of FreeCAD's own. It is one file because FreeCAD loads one file.
"""

from __future__ import annotations

import contextlib
import copy
import io
import json
import os
import re
import shlex
import shutil
import subprocess
import tempfile
from collections import namedtuple

import FreeCAD
import Path

try:
    from Path.Post.Processor import PostProcessor, PostProcessorFactory
except ImportError:  # FreeCAD 0.20 and 0.21
    PostProcessor, PostProcessorFactory = object, None

TOOLTIP = "FreeCAD's own post-processor, with the backlash of the machine compensated by ph-post"
TOOLTIP_ARGS = """--machine=FILE   machine file (.toml) or the name of a shipped one; needed
--post=NAME      FreeCAD's post-processor to write the program [that of the machine's dialect]
--ph-post=FILE   the ph-post program [where it was installed, $PH_POST, or on the path]
--no-curves      leave splines as FreeCAD sampled them
Other arguments go to that post-processor if it knows them (--no-tlo, --precision=4, ...),
else to `ph-post convert` (--max-slowdown=0.25, --strategy=dwell, --strict, ...).
"""
UNITS = "G21"
POST_TYPE = "machine"

INSTALLED = ""
"""The command that starts ph-post; `ph-post freecad --install` fills it in."""

_OWN = {"--machine": "machine", "-m": "machine", "--post": "post", "--ph-post": "ph_post"}
_MODAL = {"--modal", "--axis-modal"}
_TOLERANCE = 0.02
"""How far FreeCAD's chords may be from the curve [mm]; it samples at a deflection of 0.01 mm."""

_FLAT = 1e-6
_MANY = 3
_FINE = "--precision=5"
_PROPERTY = "backlash_arguments"

Options = namedtuple("Options", "machine post ph_post curves others")


class BacklashError(RuntimeError):
    """Why nothing was posted, in a line that FreeCAD shows."""


def export(objectslist, filename, argstring):
    """Post the objects and return the program, for FreeCAD 0.20 and 0.21; `filename` - writes no file."""
    options = read_arguments(argstring)
    told = _ask(objectslist, options)
    load = _script_loader()

    def plain(objects, more):
        return _guarded(lambda: _from_file(load(told["post"]), objects, shlex.join(more)), told["post"])

    knows = str(load(told["post"]).tooltipArgs or "")
    text = _finish(plain, objectslist, told, options, knows)
    if filename != "-":
        _write(filename, text)
    return text


class Backlash(PostProcessor):
    """The post-processor as FreeCAD 1.x makes it, by the name of the file."""

    def __init__(self, job, tooltip=TOOLTIP, tooltipargs=TOOLTIP_ARGS, units="Metric"):
        super().__init__(job=job, tooltip=tooltip, tooltipargs=tooltipargs, units=units)
        self._asked_job = job

    @classmethod
    def get_common_property_schema(cls):
        """Properties of FreeCAD's own post-processor for LinuxCNC, preamble and all."""
        try:
            return _factory("linuxcnc", None).get_common_property_schema()
        except Exception:  # whatever an unknown FreeCAD does there, its list of post-processors must not break
            return super().get_common_property_schema()

    @classmethod
    def get_property_schema(cls):
        """One property: the arguments, as a job without a machine has them."""
        label = "Backlash arguments"
        return [{"name": _PROPERTY, "type": "str", "label": label, "default": "", "help": TOOLTIP_ARGS}]

    @property
    def tooltip(self):
        """What the list of post-processors shows."""
        return TOOLTIP

    @property
    def tooltipArgs(self):
        """What the field of the arguments shows."""
        return TOOLTIP_ARGS

    def export(self):
        """Return (section, program) pairs of a job that names its post-processor itself."""
        return self._post(getattr(self._job, "PostProcessorArgs", ""), "export")

    def export2(self):
        """Return (section, program) pairs of a job with one of FreeCAD's machines; None where cancelled."""
        if not self.pre_processing_dialog():
            return None
        if not getattr(self, "_bundle_applied", False):
            self.apply_configuration_bundle()
        properties = getattr(self._machine, "postprocessor_properties", {})
        arguments = properties.get(_PROPERTY) or getattr(self._job, "PostProcessorArgs", "")
        return self._post(arguments, "export2")

    def _post(self, argstring, method):
        options = read_arguments(argstring)
        sections = self._buildPostList()
        told = _ask([item for _, items in sections for item in items], options)
        knows = _help(_factory(told["post"], self._asked_job))

        def plain(sublists, more):
            inner = self._inner(told["post"], more, sublists, method)
            return _guarded(getattr(inner, method), told["post"])

        return _finish(plain, sections, told, options, knows)

    def _inner(self, name, more, sections, method):
        """Make FreeCAD's post-processor, with the arguments and objects that it is to see; the job stays."""
        inner = _factory(name, self._asked_job)
        inner._job = _Changed(inner._job, PostProcessorArgs=shlex.join(more))
        inner._buildPostList = lambda: sections
        if method == "export2":
            inner._machine, inner._dialog_handled = self._machine, True
            _own_defaults(inner, self)
        return inner


def _help(inner):
    """Return the help text of the arguments; of a script in FreeCAD 1.x it stands beside the general one."""
    own = getattr(inner, "_tooltipargs", "")
    return own if isinstance(own, str) and own.strip() else str(getattr(inner, "tooltipArgs", "") or "")


def _own_defaults(inner, outer):
    """Set what the user left at this post-processor's defaults to the inner one's."""
    mine = {one["name"]: one.get("default") for one in outer.get_full_property_schema()}
    properties = inner._machine.postprocessor_properties
    for one in inner.get_full_property_schema():
        name = one["name"]
        if name not in properties or (name in mine and properties[name] == mine[name]):
            properties[name] = one.get("default", "")


def read_arguments(argstring):
    """Read the arguments of the job; backslashes stay, as in Windows' paths.

    Raises
    ------
    BacklashError
        Where no machine is named, a value is missing, or the editor is asked for.
    """
    words = _words(argstring)
    own, others, curves = {}, [], True
    while words:
        name, equals, value = words.pop(0).partition("=")
        if name in _OWN:
            if not equals and (not words or words[0].startswith("-")):
                raise BacklashError(f"{name}: no value; expected {name}=... in the job's arguments")
            own[_OWN[name]] = value if equals else words.pop(0)
        elif name == "--show-editor":
            raise BacklashError("--show-editor: the editor would show the program as it is before compensation")
        elif name == "--no-curves":
            curves = False
        elif name != "--no-show-editor":
            others.append(name + equals + value)
    if not own.get("machine"):
        raise BacklashError("no machine; expected --machine=FILE.toml, or a shipped one, in the job's arguments")
    return Options(os.path.expanduser(own["machine"]), own.get("post", ""), own.get("ph_post", ""), curves, others)


def _words(argstring):
    lexer = shlex.shlex(argstring or "", posix=True)
    lexer.whitespace_split, lexer.commenters, lexer.escape = True, "", ""
    try:
        return list(lexer)
    except ValueError as error:
        raise BacklashError(f"the job's arguments: {str(error).lower()}; got {argstring}") from None


def _ask(objects, options):
    """Ask ph-post for the dialect's post-processor, and for splines in place of straight moves."""
    modal = _MODAL.intersection(options.others)
    operations = [_operation(thing, options.curves and not modal) for thing in objects]
    job = {"format": "ph-post-freecad", "version": 1, "tolerance": _TOLERANCE, "operations": operations}
    told = json.loads(_run(options, ["freecad", "--trace", "-", "-m", options.machine], json.dumps(job)))
    told["post"] = options.post or told["post"]
    if not told["post"]:
        raise BacklashError(f"FreeCAD has no post-processor for the dialect {told['dialect']}; expected --post=NAME")
    if told["post"] == "backlash":
        raise BacklashError("--post=backlash: this post-processor itself; expected another one")
    return told


def _operation(thing, curves):
    commands = getattr(getattr(thing, "Path", None), "Commands", None) or []
    straight = sum(command.Name in ("G1", "G01") for command in commands) >= _MANY
    if not curves or not straight:
        return {"moves": []}
    found = {json.dumps(one, sort_keys=True): one for edge in _edges(thing) for one in _nurbs(edge)}
    moves = [[command.Name, dict(command.Parameters)] for command in commands] if found else []
    return {"moves": moves, "curves": list(found.values())}


def _edges(thing, depth=8):
    """Edges of what an operation works on: its base geometry, that below a dressup, or the job's model."""
    base = getattr(thing, "Base", None)
    if depth and base is not None and hasattr(base, "Path"):
        yield from _edges(base, depth - 1)
        return
    chosen = list(getattr(thing, "BaseShapes", None) or [])
    for one in base if isinstance(base, (list, tuple)) else []:
        owner, names = one if isinstance(one, tuple) else (one, ())
        for name in names:
            yield from owner.Shape.getElement(name).Edges
        if not any(names):
            chosen.append(owner)
    for owner in chosen or _model(thing):
        yield from getattr(getattr(owner, "Shape", None), "Edges", [])


def _model(thing, depth=4):
    """Find what the operation's job is about."""
    for parent in getattr(thing, "InList", []) if depth else []:
        model = getattr(parent, "Model", None)
        found = list(getattr(model, "Group", [])) or _model(parent, depth - 1)
        if found:
            return found
    return []


def _nurbs(edge):
    """Yield the edge as a NURBS, where it lies flat and is neither a line nor a circle, which are no news."""
    kind = getattr(getattr(edge, "Curve", None), "TypeId", "")
    if kind in ("", "Part::GeomLine", "Part::GeomCircle") or edge.BoundBox.ZLength > _FLAT:
        return
    nurbs = edge.toNurbs().Edges[0]
    curve, first, last = nurbs.Curve.copy(), nurbs.FirstParameter, nurbs.LastParameter
    if curve.isPeriodic():
        curve.setNotPeriodic()
    if first > curve.FirstParameter or last < curve.LastParameter:
        curve.segment(first, last)
    knots = [knot for knot, times in zip(curve.getKnots(), curve.getMultiplicities()) for _ in range(times)]
    points = [[pole.x, pole.y] for pole in curve.getPoles()]
    yield {"degree": curve.Degree, "knots": knots, "points": points, "weights": list(curve.getWeights())}


class _Changed:
    """An object of the document with other attributes in some places; it stays untouched itself."""

    def __init__(self, origin, **changes):
        self.__dict__.update(changes, _origin=origin)

    def __getattr__(self, name):
        return getattr(self.__dict__["_origin"], name)


def _with_splines(things, told):
    """Give the objects, or the sections of them, the moves that ph-post told."""
    left = iter(told["operations"])

    def changed(thing):
        moves = next(left)
        if moves is None:
            return thing
        path = Path.Path([Path.Command(name, words) for name, words in moves])
        if not hasattr(thing, "item_type"):
            return _Changed(thing, Path=path)
        item = copy.copy(thing)  # a Postable of the newest FreeCAD
        item.path = path
        return item

    return [
        (thing[0], [changed(item) for item in thing[1]]) if isinstance(thing, tuple) else changed(thing)
        for thing in things
    ]


def _finish(plain, things, told, options, knows):
    """Have FreeCAD's post-processor write, and ph-post compensate; sections stay sections."""
    theirs, ours = _shared_out(options.others, knows)
    written = None
    if told["splines"]:
        fine = [] if any(word.startswith("--precision") for word in theirs) or "--precision" not in knows else [_FINE]
        written = plain(_with_splines(things, told), theirs + fine)
        if _count_splines(written) != told["splines"]:
            FreeCAD.Console.PrintWarning(f"backlash: {told['post']} cannot write G5; splines stay sampled\n")
            written = None
    if written is None:
        written = plain(things, theirs)
    if isinstance(written, str):
        return _compensated(written, options, ours)
    return [(name, text and _compensated(text, options, ours)) for name, text in written]


def _shared_out(words, knows):
    """Arguments of FreeCAD's post-processor, by its help text, and those of ph-post."""
    theirs, ours = ["--no-show-editor"] if "--no-show-editor" in knows else [], []
    to = ours
    for word in words:
        if word.startswith("-"):
            name = re.escape(word.partition("=")[0])
            to = theirs if re.search(rf"(?<![\w-]){name}(?![\w-])", knows) else ours
        to.append(word)
    return theirs, ours


def _count_splines(written):
    text = written if isinstance(written, str) else "\n".join(text or "" for _, text in written)
    return len(re.findall(r"^(?:N\d+\s*)?G0?5\s", text, re.MULTILINE))


def _guarded(call, name):
    """Call FreeCAD's post-processor; where it refuses its arguments, that must not end FreeCAD."""
    said = io.StringIO()
    try:
        with contextlib.redirect_stderr(said):
            written = call()
    except SystemExit:
        written = None
    if not written:
        why = (said.getvalue().strip().splitlines() or ["it wrote nothing"])[-1]
        raise BacklashError(f"FreeCAD's post-processor {name}: {why}")
    return written


def _script_loader():
    """How FreeCAD before 1.0 loads a post-processor by its name."""
    try:
        from PathScripts.PathPostProcessor import PostProcessor as Loader
    except ImportError:
        from Path.Post.Processor import PostProcessor as Loader

    def load(name):
        if not Loader.exists(name):
            raise BacklashError(f"--post={name}: FreeCAD has no such post-processor")
        return Loader.load(name)

    return load


def _from_file(script, objects, arguments):
    """Have a script write a file and read it: not all return their program, or know the file name -."""
    with tempfile.TemporaryDirectory() as folder:
        place = os.path.join(folder, "program")
        script.export(objects, place, arguments)
        with contextlib.suppress(FileNotFoundError), open(place) as file:
            return file.read()
    return None


def _factory(name, job):
    found = PostProcessorFactory.get_post_processor(job, name)
    if found is None or isinstance(found, Exception):
        raise BacklashError(f"--post={name}: FreeCAD has no such post-processor")
    return found


def _compensated(text, options, ours):
    FreeCAD.Console.PrintMessage("backlash: ph-post compensates the program, which can take a minute\n")
    command = ["convert", "-", "-m", options.machine, *ours, "-o", "-"]
    return _run(options, command, text)


def find_ph_post(given=""):
    """Return the command that starts ph-post, a list of words.

    Raises
    ------
    BacklashError
        Where it is nowhere.
    """
    for asked, what in (
        (given, "--ph-post"),
        (os.environ.get("PH_POST", ""), "PH_POST"),
        (INSTALLED, "installed"),
    ):
        if asked:
            words = [asked] if os.path.exists(asked) else _words(asked)
            if not shutil.which(words[0]):
                raise BacklashError(f"{what}: no program of that name; got {words[0]}")
            return words
    found = shutil.which("ph-post")
    if not found:
        raise BacklashError(
            "ph-post was not found; expected it on the path, in PH_POST, or as --ph-post=FILE;"
            " `ph-post freecad --install` notes where it is"
        )
    return [found]


def _run(options, arguments, text):
    """Run ph-post on `text`, show what it says, and return what it writes."""
    command = find_ph_post(options.ph_post) + arguments
    # FreeCAD's own Python must not leak into ph-post's
    kept = {k: v for k, v in os.environ.items() if k not in ("PYTHONHOME", "PYTHONPATH")}
    hidden = getattr(subprocess, "CREATE_NO_WINDOW", 0)
    try:
        done = subprocess.run(  # noqa: S603 - the user names the program
            command, input=text.encode(), capture_output=True, check=False, env=kept, creationflags=hidden
        )
    except OSError as error:
        raise BacklashError(f"{command[0]}: cannot be started; got {error.strerror}") from None
    # it was given the program on standard input: nobody here knows that
    lines = re.sub(r"\bstdin:", "program:", done.stderr.decode(errors="replace")).splitlines()
    if done.returncode:
        raise BacklashError(_refusal(lines) or f"ph-post ended with status {done.returncode}")
    for line in lines:
        if line.startswith("warning:"):
            FreeCAD.Console.PrintWarning(f"backlash: {line}\n")
        elif not line.startswith("ph-post:"):
            FreeCAD.Console.PrintMessage(f"backlash: {line}\n")
    return done.stdout.decode()


def _refusal(lines):
    """Pick the line that says what is wrong, and the place that it shows below."""
    first = max((k for k, line in enumerate(lines) if line.startswith("ph-post:") and line[-3:] != "..."), default=0)
    return "\n".join(lines[first:])


def _write(filename, text):
    """Write the file whole or not at all."""
    folder = os.path.dirname(os.path.abspath(filename))
    try:
        handle, fresh = tempfile.mkstemp(dir=folder, prefix=".backlash-")
    except OSError as error:
        raise BacklashError(f"{filename}: cannot be written; got {error.strerror}") from None
    try:
        with os.fdopen(handle, "wb") as file:
            file.write(text.encode())
        if os.path.exists(filename):
            shutil.copymode(filename, fresh)
        else:
            os.chmod(fresh, 0o666 & ~_umask())
        os.replace(fresh, filename)
    except OSError as error:
        with contextlib.suppress(OSError):
            os.remove(fresh)
        raise BacklashError(f"{filename}: cannot be written; got {error.strerror}") from None


def _umask():
    mask = os.umask(0)
    os.umask(mask)
    return mask
