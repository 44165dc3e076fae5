"""What a program comes to when it is written out is what LinuxCNC's interpreter makes of it."""

from pathlib import Path

import pytest
from support.canon import needs_rs274
from support.interpreted import difference, interpret

from ph_post.expand.expand import Folders, expand
from ph_post.expand.faults import ExpandError, NotExpandableError

FILES = Path("/usr/share/linuxcnc/ncfiles")
PLACES = (FILES, FILES / "ngcgui_lib", FILES / "ngcgui_lib/utilitysubs", FILES / "remap_lib/common_nc_subs")
SHIPPED = sorted(
    file
    for place in (FILES, Path("/usr/share/doc/linuxcnc/examples"), Path("/usr/share/axis/images"))
    for file in place.rglob("*.ngc")
)
DECIDED = {
    "opa_demo": "#<z>",  # begins at the height at which it is started
    "smartprobe": "#5070",  # goes on by what a probe has found
    "base": "_task",  # runs one way in the preview and another on the machine
    "xyzc": "_task",
}
"""Programs in which the machine decides, and by what."""


def comes_to_the_same_calls(file):
    data, places = file.read_bytes(), (file.parent, *PLACES)
    before = interpret(data, places)
    if before.refusal:
        pytest.skip(f"the interpreter refuses the program itself: {before.refusal}")
    if file.stem in DECIDED:
        with pytest.raises(NotExpandableError, match=DECIDED[file.stem]):
            expand(data, file.name, Folders(places), parameters={})
        return
    written = expand(data, file.name, Folders(places), parameters={})
    assert difference(before, interpret(written.data)) == ""


def named_by_folder(file):
    return f"{file.parent.name}/{file.stem}"


@needs_rs274
@pytest.mark.thinned(8)
@pytest.mark.parametrize("file", SHIPPED[::6], ids=named_by_folder)
def test_shipped_programs_come_to_the_same_calls(file):
    comes_to_the_same_calls(file)


BY_HAND = sorted(Path(__file__).parents[1].glob("data/computing/*.ngc"))


@needs_rs274
@pytest.mark.parametrize("file", BY_HAND, ids=lambda file: file.stem)
def test_programs_by_hand_come_to_the_same_calls(file):
    data = file.read_bytes()
    before = interpret(data)
    assert before.refusal == ""
    written = expand(data, file.name, parameters={})
    assert written.data != data
    assert difference(before, interpret(written.data)) == ""


VALUES = (
    """
[1+2*3-4/5**2] [2**3**2] [-2**2] [7 MOD -3] [-7 MOD 3] [10-3-2] [100/10/5] [1 LT 2 AND 3 GE 3] [1 EQ 1.0000001]
[0 OR 2 AND 0] [1 XOR 1] [ABS[-3]] [ACOS[0.5]] [ASIN[-0.5]] [ATAN[1]/[-1]] [COS[60]] [EXP[1.5]] [FIX[-2.3]] [FIX[2.8]]
[FUP[-2.3]] [FUP[2.2]] [LN[10]] [ROUND[-2.5]] [ROUND[2.5]] [SIN[30]] [SQRT[2]] [TAN[45]] [1 NE 1.1] [2 LE 2] [.5+-.5]
[[1+2]*[3-[4/2]]] [-[3]] [+[3]] [3*-2] [1 - -1] [2.*.5] [SIN[ATAN[3]/[4]]*5] [1.5 GT 1.4999999]
""".replace(" MOD ", "MOD")
    .replace(" LT ", "LT")
    .replace(" AND ", "AND")
    .replace(" GE ", "GE")
    .replace(" EQ ", "EQ")
)


@needs_rs274
def test_expressions_are_worth_what_linuxcnc_says():
    found = [f"[{one}" for one in VALUES.replace("\n", " ").split(" [")[1:]]
    data = ("G21 G90\n" + "".join(f"G0 X{one}\n" for one in found) + "M2\n").encode()
    before = interpret(data)
    assert before.refusal == ""
    assert difference(before, interpret(expand(data, "a.ngc").data)) == ""


@needs_rs274
@pytest.mark.parametrize("size", [225, 240, 250])
def test_no_line_comes_out_longer_than_linuxcnc_reads(size):
    comment = "c" * (size - 33)
    lines = ["G21 G90 F100", "#1=0.333333333", f"G1 X[#1*3.1] Y[#1/7] Z#1 ({comment})", f"X[#1] (print,#1 {comment})"]
    data = "\n".join([*lines, "M2", ""]).encode()
    before = interpret(data)
    assert before.refusal == ""
    assert difference(before, interpret(expand(data, "a.ngc").data)) == ""


@needs_rs274
def test_what_the_interpreter_refuses_is_refused():
    for line in (
        "G0 X[1/0]",
        "G0 X#<none>",
        "G0 X[SQRT[-1]]",
        "o1 call",
        "G81 X1 Z-1 F9",
        "G0 X[LN[0]]",
        "#5420=1",
        "X[1",
    ):
        data = f"G21 G90 G0 X0 Y0 Z0\n#1=1\n{line}\nM2\n".encode()
        assert interpret(data).refusal != ""
        with pytest.raises(ExpandError) as found:
            expand(data, "a.ngc", parameters={})
        assert (found.value.file, found.value.line) == ("a.ngc", 3)
