"""The AXIS screen on a display that nobody sees, with a [FILTER] section, as a user has it before him."""

from __future__ import annotations

import contextlib
import json
import os
import shutil
import subprocess
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from ph_post.drive.machinefile import read_machine
from ph_post.rehearse.configuration import write_configuration
from ph_post.rehearse.linuxcnc import INSTALL, exclusive_linuxcnc
from support.pipelines import executable

SYSTEM = "/usr/bin:/bin:/usr/sbin:/sbin"
NEEDED = ("linuxcnc", "axis", "axis-remote", "Xvfb")
MISSING = [name for name in NEEDED if shutil.which(name, path=SYSTEM) is None]
WHY_NOT = f"not installed here: {', '.join(MISSING)} ({INSTALL} xvfb)"

PATIENCE = 300.0
"""Time after which the screen counts as dead [s]: beside other work on a busy computer it may take long."""

ANSWER = 30.0
"""Time after which a question is put again [s]."""

SPY = r"""
import json, sys, tkinter
import linuxcnc
screen = tkinter.Tk()
screen.wm_withdraw()
def ask(words):
    return str(screen.tk.call("send", "axis", words))
def below(widget):
    yield widget
    for child in screen.tk.splitlist(ask("winfo children " + widget)):
        yield from below(child)
shown, dialog = "", []
for widget in below("."):
    kind, front = ask("winfo class " + widget), widget.startswith(".error")
    if kind == "Text":
        text = ask(widget + " get 1.0 end")
        if front:
            dialog.append(text)
        else:
            shown = max(shown, text, key=len)
    elif front and kind == "Label":
        dialog.append(ask(widget + " cget -text"))
if "close" in sys.argv:
    ask(".error.button0 invoke")
state = linuxcnc.stat()
state.poll()
busy = ask("winfo exists .info.progress") == "1"
print(json.dumps({"file": state.file, "shown": shown, "dialog": dialog, "busy": busy}))
"""
"""Runs under the system's Python: asks the screen what it shows, and LinuxCNC which file it has loaded."""


class Axis:
    """A running AXIS screen."""

    def __init__(self, folder: Path, environment: dict[str, str]) -> None:
        self.folder = folder
        self._environment = environment

    @contextlib.contextmanager
    def opening(self, program: Path) -> Iterator[subprocess.Popen[bytes]]:
        """Open a file as ``axis-remote`` does; it comes back when the file is loaded, or the message read."""
        with subprocess.Popen(["axis-remote", str(program)], env=self._environment) as process:
            try:
                yield process
                process.wait(PATIENCE)
            finally:
                process.kill()

    def ready(self) -> bool:
        """Tell whether it answers, and has opened the program that it opens by itself."""
        if not self.call("axis-remote", "--ping"):
            return False
        seen = self.look()
        return bool(seen["file"]) and not seen["busy"]

    def look(self, *words: str) -> dict[str, Any]:
        """See which file LinuxCNC has loaded, what the screen shows, and the message in front of it.

        A question that meets the screen while it waits for another program may get no answer: it is put again.
        """
        command = ["/usr/bin/python3", "-c", SPY, *words]
        end = time.monotonic() + PATIENCE
        while True:
            try:
                done = subprocess.run(command, env=self._environment, capture_output=True, timeout=ANSWER, check=True)
                break
            except subprocess.TimeoutExpired:
                assert time.monotonic() < end
        found: dict[str, Any] = json.loads(done.stdout)
        return found

    def call(self, *words: str) -> bool:
        """Run a command of the machine's in the screen's surroundings; whether it succeeded."""
        done = subprocess.run(words, env=self._environment, capture_output=True, timeout=PATIENCE, check=False)
        return done.returncode == 0


@contextlib.contextmanager
def running_axis(lines: list[str], files: dict[str, str]) -> Iterator[Axis]:
    """Run AXIS with these lines in its [FILTER] section and these files beside its INI file.

    ``@FILTER@`` in a line is the command of this source tree.
    """
    with tempfile.TemporaryDirectory(prefix="ph-axis-", ignore_cleanup_errors=True) as place:
        folder = Path(place)
        folder.chmod(0o777)
        for name, text in files.items():
            (folder / name).write_text(text)
        ini = _configured(folder, lines)
        environment = {key: value for key, value in os.environ.items() if key != "PYTHONPATH"}
        environment |= {"PATH": SYSTEM, "HOME": place, "LIBGL_ALWAYS_SOFTWARE": "1"}
        if os.geteuid() == 0:
            environment |= {"RTAPI_UID": "65534", "RTAPI_FIFO_PATH": str(folder / "rtapi_fifo")}
        with exclusive_linuxcnc(lambda _words: None), _display(environment):
            yield from _run(ini, Axis(folder, environment), environment)


def _configured(folder: Path, lines: list[str]) -> Path:
    """Write LinuxCNC's files, with AXIS for a screen."""
    command = executable(folder / "ph-post-filter", "filter")
    ini = write_configuration(folder, read_machine("mill"), {})
    text = ini.read_text().replace(f"DISPLAY = {folder / 'display'}\n", "DISPLAY = axis\n")
    ini.write_text("\n".join([text, "[FILTER]", *lines, ""]).replace("@FILTER@", str(command)))
    return ini


@contextlib.contextmanager
def _display(environment: dict[str, str]) -> Iterator[None]:
    """Run a display under a free number."""
    words = ["Xvfb", "-displayfd", "1", "-screen", "0", "1280x900x24", "-nolisten", "tcp"]
    server = subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, env=environment, text=True)
    try:
        assert server.stdout is not None
        environment["DISPLAY"] = f":{server.stdout.readline().strip()}"
        yield
    finally:
        server.kill()
        server.communicate()


def _run(ini: Path, axis: Axis, environment: dict[str, str]) -> Iterator[Axis]:
    log = ini.with_suffix(".log")
    with log.open("wb") as output:
        process = subprocess.Popen(
            ["linuxcnc", "-r", str(ini)],
            env=environment,
            cwd=ini.parent,
            stdin=subprocess.DEVNULL,
            stdout=output,
            stderr=output,
            start_new_session=True,
        )
        try:
            end = time.monotonic() + PATIENCE
            while not axis.ready():
                assert process.poll() is None, log.read_text(errors="replace")
                assert time.monotonic() < end, log.read_text(errors="replace")
                time.sleep(0.3)
            yield axis
        finally:
            axis.call("axis-remote", "--quit")
            with contextlib.suppress(subprocess.TimeoutExpired):
                process.wait(20)
            if process.poll() is None:
                os.killpg(process.pid, 9)
                process.wait()
                axis.call("halrun", "-U")
