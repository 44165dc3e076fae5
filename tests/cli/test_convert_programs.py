"""`convert` on part programs as other programs see it: places, streams, exit status, nothing half-written."""

import io
import json
import os
import pathlib
import sys

import pytest
from support.streams import without_progress

from ph_post.cli.main import main
from ph_post.verify.verdict import Failure, Verdict

CIRCLE = b"""%
G21 G17 G90 G64 P0.005
S12000 M3 (spindle)
G0 X30 Y0 Z5
G0 X20 Y0
G1 Z-1 F300
G3 X20 Y0 I-20 J0 F1200
G0 Z5
M5
M2
%
"""
ROOMY = ("-m", "stepper", "--max-slowdown", "1", "--no-simulation")


@pytest.fixture
def circle(tmp_path):
    place = tmp_path / "circle.ngc"
    place.write_bytes(CIRCLE)
    return place


@pytest.fixture
def feed(monkeypatch):
    """Put bytes on standard input."""

    def put(data: bytes) -> None:
        monkeypatch.setattr(sys, "stdin", io.TextIOWrapper(io.BytesIO(data)))

    return put


def run(capfdbinary, *arguments):
    status = main([str(argument) for argument in arguments])
    streams = capfdbinary.readouterr()
    return status, streams.out, without_progress(streams.err.decode())


def test_a_program_is_compensated_once_and_given_back(circle, tmp_path, capfdbinary):
    out, again, back = (tmp_path / name for name in ("out.ngc", "again.ngc", "back.ngc"))
    status, printed, said = run(capfdbinary, "convert", circle, *ROOMY, "-o", out)
    assert (status, printed) == (0, b"")
    assert "compensated: X by ±0.030 mm, Y by ±0.040 mm" in said
    assert f"wrote {out}" in said
    assert b"(ph-post: offset X 0.03 mm)" in out.read_bytes()
    status, _, said = run(capfdbinary, "convert", out, *ROOMY, "-o", again)
    assert status == 0
    assert "already compensated" in said
    assert again.read_bytes() == out.read_bytes()
    assert run(capfdbinary, "convert", out, "--undo", "-o", back)[0] == 0
    assert back.read_bytes() == CIRCLE


def test_another_machine_needs_force(circle, tmp_path, capfdbinary):
    first, second, direct = (tmp_path / name for name in ("a.ngc", "b.ngc", "c.ngc"))
    run(capfdbinary, "convert", circle, *ROOMY, "-o", first)
    other = ("-m", "router", *ROOMY[2:])
    status, _, said = run(capfdbinary, "convert", first, *other, "-o", second)
    assert status == 2
    assert "--force" in said
    assert not second.exists()
    assert run(capfdbinary, "convert", first, *other, "--force", "-o", second)[0] == 0
    assert run(capfdbinary, "convert", circle, *other, "-o", direct)[0] == 0
    assert second.read_bytes() == direct.read_bytes()


def test_standard_input_to_standard_output(circle, tmp_path, capfdbinary, feed):
    out = tmp_path / "out.ngc"
    run(capfdbinary, "convert", circle, *ROOMY, "-o", out)
    feed(CIRCLE)
    status, printed, _ = run(capfdbinary, "convert", "-", *ROOMY, "-o", "-")
    assert status == 0
    assert printed == out.read_bytes()


def test_in_place_with_a_backup_and_beside(circle, capfdbinary):
    assert run(capfdbinary, "convert", circle, *ROOMY, "--suffix", "_bl")[0] == 0
    beside = circle.with_name("circle_bl.ngc").read_bytes()
    assert circle.read_bytes() == CIRCLE
    assert run(capfdbinary, "convert", circle, *ROOMY, "--in-place", "--backup")[0] == 0
    assert circle.read_bytes() == beside
    assert circle.with_name("circle.ngc.bak").read_bytes() == CIRCLE
    # Again: nothing changes, and the backup of the original is not in the way.
    assert run(capfdbinary, "convert", circle, *ROOMY, "--in-place", "--backup")[0] == 0
    assert circle.read_bytes() == beside
    assert circle.with_name("circle.ngc.bak").read_bytes() == CIRCLE
    status, _, said = run(capfdbinary, "convert", circle, "--undo", "--in-place")
    assert (status, said) == (0, f"wrote {circle}\n")
    assert circle.read_bytes() == CIRCLE


def test_undo_prints_the_object_of_a_program_that_carries_nothing_any_more(circle, tmp_path, capfdbinary):
    out, back = tmp_path / "out.ngc", tmp_path / "back.ngc"
    done = json.loads(run(capfdbinary, "convert", circle, *ROOMY, "-o", out, "--json")[1])
    status, printed, said = run(capfdbinary, "convert", out, "--undo", "--json", "-o", back)
    assert (status, said) == (0, f"wrote {back}\n")
    assert back.read_bytes() == CIRCLE
    view = json.loads(printed)
    assert list(view) == list(done)
    assert (view["verified"], view["unchanged"], view["offsets"], view["stops"]) == (True, False, {}, 0)
    assert view["cycle_time"] == view["error"] == {"before": None, "after": None}
    # Without a place for the program the object is all there is.
    assert run(capfdbinary, "convert", out, "--undo", "--json") == (0, printed, "")


def test_where_nothing_is_to_be_done_the_bytes_stay(circle, tmp_path, capfdbinary):
    out = tmp_path / "out.ngc"
    status, _, said = run(capfdbinary, "convert", circle, *ROOMY, "--strategy", "none", "-o", out)
    assert status == 0
    assert "nothing to change" in said
    assert out.read_bytes() == CIRCLE


def test_json_tells_times_errors_and_what_was_done(circle, tmp_path, capfdbinary):
    out = tmp_path / "out.ngc"
    status, printed, _ = run(capfdbinary, "convert", circle, *ROOMY[:-1], "-o", out, "--json")
    assert status == 0
    view = json.loads(printed)
    assert view["verified"] is True
    assert view["cycle_time"]["after"] > view["cycle_time"]["before"]
    # Without compensation the table stays behind by half the lost motion, 0.04 mm on Y, and more of it on X.
    assert view["error"]["after"]["max"] < 0.2 * view["error"]["before"]["max"]
    # The zero of Z was taken going down: going up it carries all of its 0.03 mm.
    assert view["offsets"] == pytest.approx({"X": 0.03, "Y": 0.04})
    turning = [(one["axis"], one["strategy"]) for one in view["windows"] if one["kind"] == "smooth"]
    assert turning == [("Y", "takeup"), ("X", "takeup"), ("Y", "takeup")]


@pytest.mark.parametrize(("strategy", "done"), [("auto", "takeup"), ("none", "none")])
def test_json_tells_what_was_done_while_an_axis_rested(tmp_path, capfdbinary, strategy, done):
    place, out = tmp_path / "frame.ngc", tmp_path / "out.ngc"
    place.write_bytes(b"G21 G90 G94\nG0 X0 Y0\nG1 X40 F600\nY20\nX0\nY0\nM2\n")
    status, printed, _ = run(capfdbinary, "convert", place, *ROOMY, "--strategy", strategy, "-o", out, "--json")
    assert status == 0
    # X rests in line 4 and goes back, Y in line 5; each is shifted at the beginning of that.
    told = [[one[key] for key in ("axis", "kind", "line", "strategy")] for one in json.loads(printed)["windows"]]
    assert told == [["X", "dwell", 4, done], ["Y", "dwell", 5, done]]


def test_json_tells_what_a_rapid_took_along(tmp_path, capfdbinary):
    place, out = tmp_path / "slots.ngc", tmp_path / "out.ngc"
    place.write_bytes(b"G21 G90 G94\nG0 X0 Z5\nG1 Z-1 F300\nX40\nG0 Z5\nG0 X0\nG1 Z-1\nX40\nM2\n")
    status, printed, _ = run(capfdbinary, "convert", place, *ROOMY, "-o", out, "--json")
    assert status == 0
    # The rapids up and back carry their changes themselves; before it cuts again each is shifted once more.
    told = [(one["axis"], one["line"], one["strategy"]) for one in json.loads(printed)["windows"]]
    assert told == [("Z", 4, "takeup"), ("X", 5, "takeup"), ("Z", 6, "takeup"), ("X", 7, "takeup")]


def test_strict_refuses_what_the_others_pass_through(tmp_path, capfdbinary):
    place, out = tmp_path / "a.ngc", tmp_path / "out.ngc"
    place.write_bytes(CIRCLE.replace(b"M5\n", b"#1=5\nM5\n"))
    status, _, said = run(capfdbinary, "convert", place, *ROOMY, "-o", out)
    assert status == 0
    assert f"{place}:9: " in said
    assert b"#1=5\n" in out.read_bytes()
    out.unlink()
    status, _, said = run(capfdbinary, "convert", place, *ROOMY, "--strict", "-o", out)
    assert status == 2
    assert said.startswith(f"ph-post: {place}:9:1: ")
    assert not out.exists()


def test_bad_input_is_told_with_a_caret_and_leaves_the_output(tmp_path, capfdbinary):
    place, out = tmp_path / "a.ngc", tmp_path / "out.ngc"
    place.write_bytes(CIRCLE.replace(b"G3 X20", b"G3 X25"))
    out.write_bytes(b"kept")
    status, _, said = run(capfdbinary, "convert", place, *ROOMY, "--strict", "-o", out)
    lines = said.splitlines()
    assert status == 2
    assert lines[0].startswith(f"ph-post: {place}:7:")
    assert lines[1].strip() == "G3 X25 Y0 I-20 J0 F1200"
    assert set(lines[2].strip()) == {"^"}
    assert out.read_bytes() == b"kept"


@pytest.mark.parametrize("step", ["replace", "fsync"])
def test_a_crash_leaves_the_original_or_the_finished_file(circle, capfdbinary, monkeypatch, step):
    def crash(*_arguments, **_named):
        raise KeyboardInterrupt

    monkeypatch.setattr(*((pathlib.Path, step) if step == "replace" else (os, step)), crash)
    assert run(capfdbinary, "convert", circle, *ROOMY, "--in-place")[0] == 130
    assert circle.read_bytes() == CIRCLE
    assert [one.name for one in circle.parent.iterdir()] == ["circle.ngc"]


def break_off(*_arguments, **_named):
    """Raise what numba raises where Ctrl-C comes while compiled code runs."""
    try:
        raise KeyboardInterrupt
    except KeyboardInterrupt as error:
        raise SystemError("CPUDispatcher(...) returned a result with an exception set") from error


def test_ctrl_c_in_compiled_code_is_no_internal_error(circle, capfdbinary, monkeypatch):
    from ph_post.api import plan_search

    monkeypatch.setattr(plan_search, "apply_edits", break_off)
    status, _, said = run(capfdbinary, "convert", circle, *ROOMY, "--in-place")
    assert (status, said) == (130, "ph-post: interrupted; nothing more was written\n")
    assert circle.read_bytes() == CIRCLE


def test_a_program_that_does_not_pass_is_not_written(circle, tmp_path, capfdbinary, monkeypatch):
    from ph_post.api import plan_search

    honest = plan_search.apply_edits
    monkeypatch.setattr(plan_search, "apply_edits", lambda *given: honest(*given).replace(b"M5\n", b"", 1))
    out = tmp_path / "out.ngc"
    status, _, said = run(capfdbinary, "convert", circle, *ROOMY, "-o", out)
    assert status == 2
    assert "does not pass its own check" in said
    assert not out.exists()


def test_a_chain_that_does_not_pass_is_left_as_it_was(tmp_path, capfdbinary, monkeypatch):
    """Of two circles the checker refuses one, its stops too: the other is compensated, the first keeps its bytes."""
    from ph_post.api import failed_changes

    place, out = tmp_path / "two.ngc", tmp_path / "out.ngc"
    cut = b"G0 X20 Y0\nG1 Z-1 F300\nG3 X20 Y0 I-20 J0 F1200\nG0 Z5\n"
    place.write_bytes(CIRCLE.replace(cut, cut + b"T2 M6\nG0 X30 Y0 Z5\n" + cut.replace(b"20", b"25")))
    honest, refused = failed_changes.verify, []

    def strict(*given, **named):
        verdict = honest(*given, **named)
        if len(refused) == 2:
            return verdict
        refused.append(Failure(kind="path", original=7, compensated=None, what="the way is another"))
        return Verdict(failures=(refused[-1],), found=1, checked=verdict.checked)

    monkeypatch.setattr(failed_changes, "verify", strict)
    status, _, said = run(capfdbinary, "convert", place, *ROOMY, "-o", out)
    assert status == 0
    assert "not compensated in lines 4 to 8: a change would not pass the check" in said
    before, _, after = out.read_bytes().partition(b"T2 M6")
    assert cut in before
    assert b"crossing" in after
    assert run(capfdbinary, "verify", place, out, "-m", "stepper")[0] == 0


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (("--feed", "100"), "--feed is for path files"),
        (("--expand", "--subprograms", "none"), "none: no such folder; expected a folder of subprograms"),
        (("--position-from", "x"), "--position-from: unknown; expected + or -; got x"),
        (("--overshoot", "0"), "--overshoot: out of range; expected a finite number > 0; got 0"),
        (("--overshoot", "0.01"), "--overshoot: less than the lost motion of "),
        (("--safe-z", "5"), "--safe-z is for path files"),
        (("--start", "moving"), "--start moving is for path files"),
        (("--strategy", "retrograde"), "--strategy retrograde is for path files"),
        (("-o", "a", "--suffix", "b"), "got -o and --suffix"),
        (("-o", "-", "--json"), "one product"),
        (("--table", "t.csv", "-o", "a"), "either -o or --table"),
    ],
)
def test_options_that_do_not_fit_are_refused(circle, capfdbinary, options, said):
    status, printed, told = run(capfdbinary, "convert", circle, "-m", "stepper", *options)
    assert (status, printed) == (2, b"")
    assert said in told


def test_a_machine_is_needed(circle, capfdbinary):
    status, _, said = run(capfdbinary, "convert", circle, "-o", "-")
    assert status == 2
    assert "--machine" in said


def test_a_path_file_has_nothing_to_undo(capfdbinary):
    status, _, said = run(capfdbinary, "convert", "circle", "--undo")
    assert status == 2
    assert "--undo is for a part program" in said


def test_standard_input_is_called_so_in_messages(capfdbinary, feed):
    feed(b"G21\nG1 X10\n")
    status, _, said = run(capfdbinary, "convert", "-", *ROOMY, "--strict", "-o", "-")
    assert status == 2
    assert said.startswith("ph-post: stdin:2:1: cut without a feed")
    feed(b"G21\nG1 X10\n")
    status, _, said = run(capfdbinary, "convert", "-", *ROOMY, "-o", "-")
    assert status == 0
    assert "stdin:2: cut without a feed: G1" in said


def test_a_closed_standard_input_is_told_in_a_line(capfdbinary, monkeypatch):
    monkeypatch.setattr(sys, "stdin", None)
    for command in (("convert", "-", *ROOMY), ("verify", "-", "part.ngc")):
        status, _, said = run(capfdbinary, *command)
        assert (status, said) == (2, "ph-post: stdin: cannot be read; got a closed stream\n")


def test_a_full_standard_output_is_told_in_a_line(circle, capfdbinary, monkeypatch):
    class Full(io.StringIO):
        def write(self, _text):
            raise OSError(28, "No space left on device")

    monkeypatch.setattr(sys, "stdout", Full())
    status, _, said = run(capfdbinary, "verify", circle, circle)
    sys.stdout.close()
    assert (status, said) == (
        2,
        "ph-post: standard output: cannot be read or written; got No space left on device\n",
    )


@pytest.mark.parametrize(
    ("words", "what"),
    [
        (("-o", "missing/out.ngc"), "missing/out.ngc: cannot be written; expected an existing folder"),
        (("-o", "out.ngc", "--plot", "missing/a.png"), "missing/a.png: cannot be written; expected an existing folder"),
        (("-o", "part.ngc"), "-o would write over IN (part.ngc)"),
        (("-o", "out.png", "--plot", "./out.png"), "./out.png can take one product; got -o and --plot"),
    ],
)
def test_where_the_result_goes_is_looked_at_before_the_work(monkeypatch, tmp_path, capsys, words, what):
    monkeypatch.chdir(tmp_path)
    pathlib.Path("part.ngc").write_text("G21 G90\nG0 X0 Y0\nG3 X0 Y0 I10 J0 F800\nM2\n")
    monkeypatch.setattr("ph_post.api.program_compensation.ProgramCompensation", None)
    assert main(["convert", "part.ngc", "-m", "stepper", *words]) == 2
    assert what in capsys.readouterr().err
    assert [one.name for one in tmp_path.iterdir()] == ["part.ngc"]
