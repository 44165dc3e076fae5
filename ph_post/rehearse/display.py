"""Stand-in for LinuxCNC's screen: runs one program, and records the commands of the joints.

Runs under the system's Python, where LinuxCNC's modules are, and uses nothing else. It reads what to do from
the file that PH_POST_JOB names, and leaves two beside it: ``rows.txt``, what ``halsampler`` wrote, and
``result.json``. When it ends, LinuxCNC shuts down.
"""

from __future__ import annotations

import json
import mmap
import os
import pathlib
import signal
import struct
import subprocess
import time
from typing import Any

import linuxcnc

START_UP = 20.0
"""Time within which LinuxCNC has to answer [s]."""

POLL = 0.01
"""Time between two looks at its state [s]."""

SETTLED = 3
"""So many looks in a row have to find a program over."""


class HeadlessMachine:
    """A running LinuxCNC."""

    def __init__(self) -> None:
        self.command, self.state = linuxcnc.command(), linuxcnc.stat()
        self.errors = linuxcnc.error_channel()
        self.messages: list[str] = []
        self.line = 0

    def wait_for_task(self) -> None:
        """Wait until its task answers."""
        end = time.monotonic() + START_UP
        while True:
            try:
                self.state.poll()
            except linuxcnc.error:
                if time.monotonic() > end:
                    raise
                time.sleep(POLL)
            else:
                return

    def switch_on(self) -> None:
        """Take it out of emergency stop, and say that it stands at the origin."""
        self.do(self.command.state, linuxcnc.STATE_ESTOP_RESET)
        self.do(self.command.state, linuxcnc.STATE_ON)
        self.do(self.command.mode, linuxcnc.MODE_MANUAL)
        self.do(self.command.home, -1)
        end = time.monotonic() + START_UP
        while not all(self.state.homed[: self.state.joints]) and time.monotonic() < end:
            time.sleep(POLL)
            self.state.poll()
        self.do(self.command.teleop_enable, 1)
        self.do(self.command.set_block_delete, 0)
        self.do(self.command.set_optional_stop, 0)

    def do(self, function: Any, *arguments: object) -> None:
        """Give a command and wait until it is taken."""
        function(*arguments)
        self.command.wait_complete()

    def collect(self) -> bool:
        """Take the messages that have come in; return true where one of them is an error."""
        bad = False
        while (found := self.errors.poll()) is not None:
            kind, text = found
            if kind in (linuxcnc.NML_ERROR, linuxcnc.OPERATOR_ERROR):
                self.messages.append(text.strip())
                bad = True
        return bad

    def run(self, program: str, limit: float) -> str:
        """Run a program: "ok", "error" or "limit"."""
        self.do(self.command.mode, linuxcnc.MODE_AUTO)
        self.do(self.command.program_open, program)
        self.command.auto(linuxcnc.AUTO_RUN, 0)
        self.command.wait_complete()
        end, over = time.monotonic() + limit, 0
        while over < SETTLED:
            time.sleep(POLL)
            self.state.poll()
            self.line = max(self.line, self.state.read_line)
            if self.collect():
                return "error"
            if time.monotonic() > end:
                self.command.abort()
                return "limit"
            if self.state.interp_state == linuxcnc.INTERP_PAUSED:
                self.command.auto(linuxcnc.AUTO_RESUME)
            idle = self.state.interp_state == linuxcnc.INTERP_IDLE
            over = over + 1 if idle and self.state.inpos and self.state.queue == 0 else 0
        return "error" if self.collect() else "ok"


def set_clock(clock: str, fast: bool) -> None:
    """Let time pass as it does on the wall, or as fast as it can."""
    if not clock:
        return
    with open(clock, "r+b") as file, mmap.mmap(file.fileno(), 4) as page:  # noqa: PTH123
        page[:4] = struct.pack("i", fast)


def main() -> None:
    """Do the job."""
    place = pathlib.Path(os.environ["PH_POST_JOB"])
    job = json.loads(place.read_text())
    machine, outcome = HeadlessMachine(), "error"
    (place.parent / "display.pid").write_text(str(os.getpid()))
    try:
        machine.wait_for_task()
        machine.switch_on()
        with (place.parent / "rows.txt").open("wb") as rows:
            recorder = subprocess.Popen(["halsampler", "-t"], stdout=rows)  # noqa: S607
            time.sleep(0.1)
            set_clock(job["clock"], fast=True)
            outcome = machine.run(job["program"], job["limit"])
            set_clock(job["clock"], fast=False)
            time.sleep(0.1)
            recorder.send_signal(signal.SIGINT)
            recorder.wait(START_UP)
    except linuxcnc.error as error:
        machine.messages.append(str(error))
    finally:
        set_clock(job["clock"], fast=False)
        result = {"outcome": outcome, "messages": machine.messages, "line": machine.line}
        (place.parent / "result.json").write_text(json.dumps(result))


if __name__ == "__main__":
    main()
