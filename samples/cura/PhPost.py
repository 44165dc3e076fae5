"""ph-post in Cura: a post-processing script that hands the program to ``ph-post-slicer``.

Copy this file to the folder ``scripts`` in Cura's configuration folder (Help > Show Configuration Folder),
start Cura again, and add it under Extensions > Post Processing > Modify G-Code. Where ph-post fails, the
program stays as it is and Cura shows why.
"""

import json
import os
import re
import shlex
import subprocess
import tempfile

from UM.Logger import Logger
from UM.Message import Message

from ..Script import Script

SETTINGS = {
    "name": "ph-post: backlash compensation",
    "key": "PhPost",
    "metadata": {},
    "version": 2,
    "settings": {
        "executable": {
            "label": "Executable",
            "description": "Where ph-post-slicer is, such as /home/me/ph_post/.venv/bin/ph-post-slicer.",
            "type": "str",
            "default_value": "ph-post-slicer",
        },
        "machine": {
            "label": "Machine file",
            "description": "The machine file (.toml) of this printer, or the name of a shipped one.",
            "type": "str",
            "default_value": "",
        },
        "options": {
            "label": "Options",
            "description": "More options of ph-post-slicer, such as --max-slowdown 0.25.",
            "type": "str",
            "default_value": "",
        },
    },
}

FOREIGN = ("PYTHONHOME", "PYTHONPATH", "LD_LIBRARY_PATH", "DYLD_LIBRARY_PATH")
"""What Cura, which brings its own Python, sets for itself and another Python cannot start with."""


class PhPost(Script):
    """Compensates the whole program at once: Cura hands it over in pieces, a layer each."""

    def getSettingDataString(self):
        """Return what Cura asks the user for."""
        return json.dumps(SETTINGS)

    def execute(self, data):
        """Return the compensated program in pieces, or the pieces as they came where that fails."""
        program = "".join(data)
        try:
            return split(self._compensated(program))
        except (OSError, ValueError, subprocess.SubprocessError) as error:
            Logger.log("e", "ph-post: %s", error)
            Message(f"{error}. The program stays as it was.", title="ph-post").show()
            return data

    def _compensated(self, program):
        with tempfile.TemporaryDirectory(prefix="ph-post-") as folder:
            place = os.path.join(folder, "cura.gcode")  # noqa: PTH118
            with open(place, "w", encoding="utf-8", newline="") as file:  # noqa: PTH123
                file.write(program)
            self._run(place)
            with open(place, encoding="utf-8", newline="") as file:  # noqa: PTH123
                return file.read()

    def _run(self, place):
        """Run ph-post-slicer on a file; what it says becomes the error where it fails."""
        words = [self.getSettingValueByKey("executable")]
        if self.getSettingValueByKey("machine"):
            words += ["-m", self.getSettingValueByKey("machine")]
        words += shlex.split(self.getSettingValueByKey("options") or "")
        try:
            done = subprocess.run(  # noqa: S603 - the user's own command
                [*words, place],
                env={name: value for name, value in os.environ.items() if name not in FOREIGN},
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.PIPE,
                creationflags=getattr(subprocess, "CREATE_NO_WINDOW", 0),
                check=False,
            )
        except OSError as error:
            what = f"Executable: {words[0]!r} cannot be run ({error.strerror})"
            raise ValueError(f"{what}; expected where ph-post-slicer is, written out in full") from None
        said = done.stderr.decode(errors="replace").strip()
        if done.returncode:
            raise ValueError(said or f"{words[0]} ended with exit status {done.returncode}")
        Logger.log("i", "%s", said)


def split(program):
    """Cut a program where Cura does, before each layer: scripts behind this one count on that."""
    return re.split(r"(?m)^(?=;LAYER:)", program)
