"""LinuxCNC's interpreter in full precision: run by the Python that has its module, it prints its calls as JSON."""

import ctypes
import json
import sys
import tempfile
from pathlib import Path


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
        pass

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


def main():
    import gcode

    # The table of tools is the one that rs274 left in the home folder.
    ctypes.CDLL("libtooldata.so.0", mode=ctypes.RTLD_GLOBAL)._Z14tool_mmap_userv()
    with tempfile.TemporaryDirectory() as folder:
        canon = Canon(folder)
        Path(canon.parameter_file).touch()
        result, line = gcode.parse(sys.argv[1], canon, "", "")
    refusal = f"{gcode.strerror(result)} at line {line}" if result > gcode.MIN_ERROR else ""
    sys.stdout.write("\n" + json.dumps({"calls": canon.calls, "refusal": refusal}))


if __name__ == "__main__":
    main()
