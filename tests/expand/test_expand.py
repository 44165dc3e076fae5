"""Programs that are written out: what stays, what is refused and where, and the way back."""

import re

import pytest

from ph_post.api.expansion import before_expansion, written_out
from ph_post.dialects.reading import read_as
from ph_post.errors import InputError
from ph_post.expand.expand import ExpandError, Folders, expand
from ph_post.expand.writing import EXPANDED

HEAD = "G21 G90 G17 G98 G64 P0.01\nG0 X0 Y0 Z5\n"


def lines_of(text, **how):
    """Lines of a program that was written out, without what ph-post adds."""
    data = expand(text.encode("latin-1"), "a.ngc", **how).data
    return [line for line in data.decode("latin-1").splitlines() if "ph-post-expand" not in line]


def fault_of(text, folders=None):
    with pytest.raises(ExpandError) as found:
        expand(text.encode(), "a.ngc", folders)
    return found.value


@pytest.mark.parametrize(
    ("text", "line", "what"),
    [
        ("#1=0\no1 while [#1 LT 5]\nG1 X1\no1 endwhile\n", 2, "never ends"),
        ("o1 while [1]\n#1=[#1+1]\no1 endwhile\n", None, "without an end"),
        ("o1 sub\no2 while [1]\n#1=[#1+1]\no2 endwhile\no1 endsub\nG71 Q1\n", None, "without an end"),
        ("#1=1\no1 do\nG0 X1\nX2\no1 while [#1]\n", 5, "never ends"),
        ("o1 sub\no1 call\no1 endsub\no1 call\n", 2, "deep"),
        ("o1 sub\no2 call\no1 endsub\no2 sub\no1 call\no2 endsub\no1 call\n", None, "deep"),
        ("G0 X1\no<gone> call [1]\n", 2, "not there"),
        ("M98 P1000\n", 1, "not there"),
        ("G1 X[1/[2-2]]\n", 1, "division by zero"),
        ("G0 X1 Y1 Z1\nG81 X1 Z-1\n", 2, "without R"),
        ("G0 X1 Y1 Z1\nG82 X1 Z-1 R1\n", 2, "without P"),
        ("G0 X1 Y1 Z1\nG83 X1 Z-1 R1\n", 2, "without Q"),
        ("G0 X1 Y1 Z1\nG81 X1 R1\n", 2, "without Z"),
        ("G0 X1 Y1 Z1\nG81 X1 R-2 Z-1\n", 2, "below the bottom"),
        ("G0 X1 Y1 Z1\nG81 X1 R2 Z-1 L0\n", 2, "without repeats"),
        ("#1=[2**5000]\n", 1, "beyond all bounds"),
        ("#1=[EXP[1000]]\n", 1, "beyond all bounds"),
        ("#1=" + "[" * 5000 + "1" + "]" * 5000 + "\n", 1, "too deep"),
        ("#1=[1+]\n", 1, "no value"),
        ("#1=[1\n", 1, "not whole"),
        ("#1=FOO[1]\n", 1, "no such function"),
        ("#9999=1\n", 1, "no such parameter"),
        ("#[1/3]=1\n", 1, "no such parameter"),
        ("#5422=1\n", 1, "only be read"),
        ("G0 X#<never>\n", 1, "no value yet"),
        ("o1 if [1]\nG0 X1\n", None, None),
        ("o1 while [0]\nG0 X1\n", 1, "no end"),
        ("o1 endwhile\n", 1, "without its beginning"),
        ("o1 break\n", 1, "outside of a loop"),
        ("o1 fly\n", 1, "no order"),
        ("o1 return\n", 1, "outside of its subprogram"),
        ("#1=1\nM99\n", 2, "never ends"),
        ("G38.2 Z-5 F10\n#1=#5063\nG0 Z[#1+1]\n", 3, "only the machine knows: #5063, the place of a probing"),
        ("M66 P1 L0\no1 if [#5399 EQ 1]\nG0 X1\no1 endif\n", 2, "#5399, an input of the machine"),
        ("G0 X[#5420+1]\n", 1, "#5420, the position"),
        ("G0 Z[#5223]\n", 1, "#5223, a work offset"),
        ("G0 X#<_hal[some.pin]>\n", 1, "only the machine knows"),
        ("G98 G81 X1 Z-1 R1 F90\n", 1, "Z is not known"),
        ("/#1=5\nG0 X#1\n", 1, "slash"),
        ("M72\n", 1, "without M70"),
        ("G21 G90\nM70\nG92 X0\nM72\n", 4, "whether one was in force"),
        ("%\n#1=1\n% led on\nG0 X#1\n%\n", 3, "text behind a percent sign"),
        ("%\n#1=1\n%(led on)\nG0 X#1\n%\n", 3, "text behind a percent sign"),
        ("o1 sub\no2 sub\no2 endsub\no1 endsub\no1 call\n", 2, "within a subprogram"),
    ],
)
@pytest.mark.filterwarnings("error")
def test_what_cannot_be_written_out_is_named_with_its_line(text, line, what):
    head = "G21 G90 G17 G54 F100\n"
    if what is None:
        expand((head + text).encode(), "a.ngc")
        return
    error = fault_of(head + text)
    assert what in error.what, error.what
    assert error.file == "a.ngc"
    assert line is None or error.line == line + 1


def test_a_loop_with_an_end_far_off_is_run_to_it():
    found = lines_of("G21\n#1=0\no1 while [#1 LT 9000]\n#1=[#1+1]\no1 endwhile\nG0 X#1\nM2\n")
    assert found == ["G21", "G0 X9000", "M2"]


def test_plain_lines_stay_as_they_are():
    kept = [" n10  g1x 1 . 5 ( edge )", "(a title)", "/G1 X7", "M3 S100 ; on", "", "\tG0 Z9"]
    assert lines_of("\n".join([*kept, "#1=4", "G0 X#1 (there)", "M2", ""])) == [*kept, "G0 X4 (there)", "M2"]


def test_a_program_that_computes_nothing_is_itself():
    plain = [b"(o1 call [5])\nG1 X1\n", b"G21 G90\r\nG1 X1 F100\r\nM2", b"%\nG0 G81.1\nM730\n%\n"]
    for text in (*plain, b"(#1 = [2])\nG0 X1 ; O100 call\nM2\n"):
        assert expand(text, "a.ngc").data == text


def test_a_percent_sign_and_line_ends_stay():
    data = b"%\r\n#1=5\r\nG0 X#1\r\n%\r\nwhat follows\r\n"
    found = expand(data, "a.ngc").data
    assert found.startswith(b"%\r\n(ph-post-expand: ")
    assert b"\r\nG0 X5\r\n%\r\n(ph-post-expand: undo 1/" in found
    assert b"\n" not in found.replace(b"\r\n", b"")


@pytest.mark.parametrize(
    "data", [b"#1=1\nG0 X#1", b"#1=1\nG0 X#1\r\n(\xe4\xff)\nM2", b"%\n#1=2\nX#1\n%", b"#1=1\rG0 X#1\rM2\r"]
)
def test_the_original_comes_back_byte_for_byte(data):
    found = expand(data, "a.ngc").data
    assert found != data
    assert before_expansion(found, "a.ngc") == data
    assert expand(found, "a.ngc").data == found


def test_a_change_behind_is_told():
    found = expand(b"#1=1\nG0 X#1\nM2\n", "a.ngc").data
    with pytest.raises(InputError, match="changed after it was written out"):
        before_expansion(found.replace(b"G0 X1\n", b"G0 X2\n"), "a.ngc")
    with pytest.raises(InputError, match="missing"):
        before_expansion(found[: found.index(b"undo 1/") + 10] + b"\n", "a.ngc")
    with pytest.raises(InputError, match="damaged"):
        before_expansion(re.sub(rb"(undo 1/\d+ )..", rb"\1NN", found), "a.ngc")


def test_subprograms_are_found_in_folders_and_kept(tmp_path):
    (tmp_path / "corner.ngc").write_text("o<corner> sub\nG0 X#1\no<corner> endsub\nM2\n")
    data = b"G21\no<corner> call [3]\nM2\n"
    folders = Folders((tmp_path / "none", tmp_path))
    found = expand(data, "a.ngc", folders).data
    assert b"\nG0 X3\n" in found
    kept = EXPANDED.read(found, "a.ngc")
    assert list(kept.files) == ["corner.ngc"]
    (tmp_path / "corner.ngc").write_text("o<corner> sub\nG0 X9\no<corner> endsub\n")
    before, after = read_as("linuxcnc", data, "a.ngc"), read_as("linuxcnc", found, "a.ngc")
    assert written_out(before, after).data == found
    other = read_as("linuxcnc", b"G21\no<corner> call [4]\nM2\n", "b.ngc")
    assert written_out(other, after) is other


def test_a_fault_in_a_subprogram_names_its_file(tmp_path):
    (tmp_path / "bad.ngc").write_text("o<bad> sub\n(one)\nG0 X[1/#1]\no<bad> endsub\n")
    error = fault_of("o<bad> call [0]\n", Folders((tmp_path,)))
    assert (error.file, error.line, error.what) == ("bad.ngc", 3, "division by zero")
    (tmp_path / "bad.ngc").write_text("o<bad> sub\nG0 X1\n")
    assert "ends within it" in fault_of("o<bad> call [0]\n", Folders((tmp_path,))).what
    assert "not there" in fault_of("o<../bad> call\n", Folders((tmp_path / "x",))).what


def test_where_no_path_mode_is_known_stops_keep_cycles_exact():
    found = lines_of("G21 G90 G98\nG0 X0 Y0 Z5\nG81 X1 Y2 Z-1 R1 F90\nG80\nM2\n")
    assert found[2:] == ["F90", "G0 X1 Y2", "G4 P0", "G0 Z1", "G4 P0", "G1 Z-1", "G4 P0", "G0 Z5", "G4 P0", "G80", "M2"]
    assert lines_of(HEAD + "G81 X1 Y2 Z-1 R1 F90\nM2\n")[2:] == [
        *("F90", "G61", "G0 X1 Y2", "G0 Z1", "G1 Z-1", "G0 Z5", "G64 P0.01", "M2")
    ]


def test_cycles_stand_where_nobody_knows_to_which_height_they_retract():
    text = "G21 G90\nG0 X0 Y0 Z5\n#1=1\nG81 X#1 Y2 Z-1 R1 F90\nX3\nG80\nG99 G0 Z1\nG81 X4 Z-1 R1\nM2\n"
    found = lines_of(text)
    assert found[2:5] == ["G81 X1 Y2 Z-1 R1 F90", "X3", "G80"]
    assert "G0 X4" in " ".join(found)


def test_notes_say_what_was_taken_to_be_zero():
    assert expand(b"G0 X#7 Y#100\n", "a.ngc").notes == (
        "taken to be 0, as nothing was put there before they were read: #7, #100",
    )
    assert expand(b"G0 X#7\n", "a.ngc", parameters={7: 2.5}).notes == ()
    assert lines_of("G0 X#170\n", parameters={170: 2.5}) == ["G0 X2.5"]


CONTOUR = "G1 X5\nY5\nX0\nG40 X-5\nM2\n"


@pytest.mark.parametrize(
    ("text", "why"),
    [
        (HEAD + "G41 D4\n" + CONTOUR, "3: cutter compensation stays as it is: the radius of tool 4 is not known"),
        (HEAD + "G41\n" + CONTOUR, "which tool is in the spindle is not known"),
        (HEAD + "G41.1 D9\n" + CONTOUR, "the tool cuts into a concave corner at a line (line 6)"),
        (HEAD + "G41.1 D12\n" + CONTOUR, "not longer than the tool's radius (line 4)"),
        (HEAD + "G41.1 D2\nG3 X1 Y1 R.9\n" + CONTOUR, "does not fit into the arc (line 4)"),
        (HEAD + "G41.1 D2\nG1 X5\nG28 Z0\n" + CONTOUR, "G28 with cutter compensation on (line 5)"),
        (HEAD + "G41.1 D2\nG1 X5\nG1 X[#5420+9]\n" + CONTOUR, "X depends on what only the machine knows"),
        (HEAD + "G41.1 D2\nG93\n" + CONTOUR, "G93 with cutter compensation on (line 4)"),
        ("G21 G90\nG41.1 D2\n" + CONTOUR, "the place where the compensation begins is not known"),
        (HEAD + "G19 G41.1 D2\n" + CONTOUR, "the plane of the compensation"),
        (HEAD + "G41.1 D2 G93\n" + CONTOUR, "under G93"),
    ],
)
def test_compensation_that_cannot_be_had_stays_and_is_named(text, why):
    if "#" in text:
        assert why in fault_of(text).what
        return
    found = expand(text.encode(), "a.ngc")
    assert found.data == text.encode()
    assert why in found.notes[0]
    computing = expand(b"#1=7\nG0 X#1\n" + text.encode(), "a.ngc").data
    assert computing.split(b"G0 X7\n")[1].startswith(text.encode())


def test_a_comment_with_an_empty_name_stays():
    assert lines_of("#1=2\n(debug, #<> and #1)\nM2\n")[0] == "(debug, #<> and 2.000000)"


def test_words_of_a_machine_s_own_may_set_parameters():
    """A remapped word runs a program of its own."""
    lines = [b"#31=5", b"#<_far>=6", b"G88.5", b"G90 G1 X1 F100", b"M2", b""]
    for computed in (b"X#31", b"X#<_far>", b"X#<_new>", b"X#4000"):
        with pytest.raises(ExpandError, match="depends on what only the machine knows"):
            expand(b"\n".join([*lines[:4], computed, *lines[4:]]), "a.ngc")
    assert b"\nX5\n" in expand(b"\n".join([*lines[:2], b"X#31", *lines[4:]]), "a.ngc").data


def test_a_negative_number_to_a_power_that_only_the_machine_knows_is_not_known():
    with pytest.raises(ExpandError, match="depends on what only the machine knows"):
        expand(b"G90 G1 X[[0-2] ** #5061] F100\nM2\n", "a.ngc")


def test_folders_look_for_what_is_asked_whoever_asked_before(tmp_path):
    (tmp_path / "5.nc").write_text("M99")
    (tmp_path / "5.ngc").write_text("M2")
    folders = Folders((tmp_path,))
    for endings, name in (((".nc",), "5.nc"), ((".ngc",), "5.ngc"), ((".x", ".nc"), "5.nc")):
        found = folders.find("5", endings)
        assert found is not None
        assert found.name == name
    assert folders.find("5").name == "5.ngc"
