"""A real LinuxCNC installed beside this package, run without a screen: interpreter, planner and motion."""
