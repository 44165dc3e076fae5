"""LinuxCNC's interpreter in full precision, run by the Python that has its module: it forks for each program.

To start Python and load the module takes several times as long as most programs. A line of input is a folder, in
which are `program.ngc`, `machine.ini`, and the table of tools that rs274 left; the line that answers is the status of
the process that wrote its calls to `calls.json` there.
"""

import ctypes
import json
import os
import signal
import sys
import tempfile
from pathlib import Path

LONGEST = 60
"""Time [s] after which a program is ended."""


class Canon:
    """Writes down every call; what the interpreter asks for is that of a machine in mm, with all axes."""

    def __init__(self, folder):
        self.calls = []
        self.parameter_file = str(Path(folder, "parameters.var"))
        self.random_toolchanger = 0

    def __getattr__(self, name):
        if name.startswith(("_", "get_")):
            raise AttributeError(name)
        return lambda *args: self.calls.append([name, *args])

    def next_line(self, state):
        pass

    def comment(self, text):
        # The module says nothing of the spindle: `canon_player.py` has marked where it is switched.
        if text in ("spindle on", "spindle off"):
            self.calls.append([text])

    def set_traverse_rate(self, rate):
        pass

    def check_abort(self):
        return False

    def get_external_angular_units(self):
        return 1.0

    def get_external_length_units(self):
        return 1.0

    def get_axis_mask(self):
        return 511

    def get_block_delete(self):
        return 0

    def get_tool(self, pocket):
        return (-1,) + (0.0,) * 9 + (0.0, 0.0, 0.0, 0)


def interpret(folder):
    """Interpret the program of a folder, in a process and a home of its own."""
    import gcode

    signal.alarm(LONGEST)
    os.chdir(folder)
    os.environ.update(HOME=folder, INI_FILE_NAME=str(Path(folder, "machine.ini")))
    with Path(folder, "said.txt").open("wb") as said:  # what the program prints, and why it fails
        os.dup2(said.fileno(), 1)
        os.dup2(said.fileno(), 2)
    ctypes.CDLL("libtooldata.so.0", mode=ctypes.RTLD_GLOBAL)._Z14tool_mmap_userv()
    with tempfile.TemporaryDirectory() as own:
        canon = Canon(own)
        Path(canon.parameter_file).touch()
        result, line = gcode.parse(str(Path(folder, "program.ngc")), canon, "", "")
    refusal = f"{gcode.strerror(result)} at line {line}" if result > gcode.MIN_ERROR else ""
    Path(folder, "calls.json").write_text(json.dumps({"calls": canon.calls, "refusal": refusal}))


def main():
    import gcode  # noqa: F401 - what the processes share

    for line in sys.stdin:
        child = os.fork()
        if child == 0:
            try:
                interpret(line.rstrip("\n"))
                os._exit(0)
            except BaseException:
                import traceback

                traceback.print_exc()
            finally:
                os._exit(1)
        status = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
        sys.stdout.write(f"{status}\n")
        sys.stdout.flush()


if __name__ == "__main__":
    main()
