"""`convert --watch` as a process of its own, beside programs that write, rename and delete."""

import itertools
import os
import shutil
import signal
import time

import pytest
from support.pipelines import ROOT, watching
from support.shop import CIRCLE, SLOT

from ph_post.cli import watch
from ph_post.cli.convert import command
from ph_post.cli.main import main
from ph_post.cli.watch import Watcher
from ph_post.edit.undo import undo

CIRCLE = CIRCLE.replace(" Q0", "")
SLOT = SLOT.replace(" Q0", "")

CLOCK = itertools.count(0, 3)
"""Time [s], further at every look than a file has to settle."""


@pytest.fixture
def folders(tmp_path):
    """The folder that is watched, with a blank in its name, and that of the programs."""
    source = tmp_path / "from cam"
    source.mkdir()
    return source, tmp_path / "to_machine"


def test_what_is_there_and_what_comes_is_converted(folders):
    source, target = folders
    (source / "here already.ngc").write_text(CIRCLE)
    (source / "notes.md").write_text("no program")
    (source / ".part.ngc").write_text("being copied")
    (source / "folder.ngc").mkdir()
    with watching(source, "-o", target) as watched:
        line = watched.wait_for("here already.ngc")
        assert "compensated: X by ±0.030 mm" in line
        assert line.endswith(f"; wrote {target / 'here already.ngc'}")
        # Two at once.
        (source / "a.ngc").write_text(CIRCLE)
        (source / "b.nc").write_text(SLOT)
        watched.wait_for("wrote " + str(target / "b.nc"))
        assert watched.stop() == 0
    for name, text in {"here already.ngc": CIRCLE, "a.ngc": CIRCLE, "b.nc": SLOT}.items():
        assert undo((target / name).read_bytes(), name) == text.encode()
    assert sorted(one.name for one in target.iterdir()) == ["a.ngc", "b.nc", "here already.ngc"]
    assert watched.said[-1] == "stopped; 3 converted, 0 refused"
    assert (source / "a.ngc").read_text() == CIRCLE


@pytest.mark.slow
def test_a_half_written_file_is_left_until_it_is_whole(folders):
    source, target = folders
    with watching(source, "-o", target) as watched, (source / "part.ngc").open("w") as file:
        for line in SLOT.splitlines(keepends=True):
            file.write(line)
            file.flush()
            time.sleep(0.3)  # half as long as it has to stay as it is
        file.close()
        watched.wait_for("wrote")
        assert watched.stop(signal.SIGINT) == 0
    assert undo((target / "part.ngc").read_bytes(), "part") == SLOT.encode()
    assert watched.said[-1] == "stopped; 1 converted, 0 refused"


@pytest.mark.slow
def test_a_file_that_changes_or_is_replaced_is_converted_again(folders, tmp_path):
    source, target = folders
    part = source / "part.ngc"
    with watching(source, "-o", target) as watched:
        part.write_text(CIRCLE)
        watched.wait_for("wrote")
        part.write_text(SLOT)
        watched.wait_for("wrote")
        assert undo((target / "part.ngc").read_bytes(), "part") == SLOT.encode()
        other = tmp_path / "other"
        other.write_text(CIRCLE)
        other.replace(part)
        watched.wait_for("wrote")
        assert undo((target / "part.ngc").read_bytes(), "part") == CIRCLE.encode()
        part.rename(source / "renamed.ngc")
        watched.wait_for(f"wrote {target / 'renamed.ngc'}")
    assert (target / "renamed.ngc").read_bytes() == (target / "part.ngc").read_bytes()


@pytest.mark.slow
def test_a_bad_file_is_named_and_the_next_has_its_turn(folders):
    source, target = folders
    with watching(source, "-o", target, "--strict") as watched:
        (source / "bad.ngc").write_text(SLOT.replace("I0 J6", "I0 J7"))
        assert watched.wait_for("bad.ngc").startswith(f"ph-post: {source / 'bad.ngc'}:7:1: radii of the arc")
        (source / "empty.ngc").write_text("")
        (source / "latin.json").write_bytes(b"\xff")
        watched.wait_for("latin.json:1:1: not a text file; expected UTF-8")
        (source / "good.ngc").write_text(SLOT)
        watched.wait_for("wrote")
        (source / "bad.ngc").write_text(SLOT)
        watched.wait_for(f"wrote {target / 'bad.ngc'}")
        assert watched.stop() == 0
    assert f"ph-post: {source / 'empty.ngc'}: the file is empty" in watched.said
    assert watched.said[-1] == "stopped; 2 converted, 3 refused"


def watcher(source, *words, machine="stepper"):
    """Return a watcher as the command makes it, with a clock that the test moves."""
    words = ["--watch", str(source), "-m", machine, "--max-slowdown", "1", *map(str, words)]
    return Watcher(str(source), command.make_context("convert", words).params)


def converted(watched, times=2):
    """Look so often that whatever is there is taken; all that was converted so far."""
    for _ in range(times):
        watched.step(float(next(CLOCK)))
        watched.step(float(next(CLOCK)))
    return watched.converted


def test_what_is_there_at_the_start_may_be_half_written_too(folders):
    source, target = folders
    (source / "part.ngc").write_text(CIRCLE)
    watched = watcher(source, "-o", target)
    now = float(next(CLOCK))
    watched.step(now)
    watched.step(now + 1.9)
    assert watched.converted == 0
    watched.step(now + 2.0)
    assert watched.converted == 1


def test_beside_it_never_takes_what_it_wrote_itself(folders):
    source, _ = folders
    watched = watcher(source, "--suffix", "_bl")
    (source / "part.ngc").write_text(CIRCLE)
    assert converted(watched) == 1
    (source / "next.ngc").write_text(CIRCLE)
    assert converted(watched) == 2
    assert converted(watcher(source, "--suffix", "_bl")) == 0
    assert sorted(one.name for one in source.iterdir()) == [
        "next.ngc",
        "next_bl.ngc",
        "part.ngc",
        "part_bl.ngc",
    ]


def test_a_path_file_becomes_a_program(folders, capsys):
    source, target = folders
    watched = watcher(source, "-o", target, "--strategy", "suppress", "--safe-z", "5", "--depth", "-1")
    shutil.copy(ROOT / "paths" / "circle.json", source)
    assert converted(watched) == 1
    said = capsys.readouterr().err.splitlines()[0]
    assert said.startswith(f"{source / 'circle.json'}: circle of the paper's example: ")
    assert said.endswith(f"; wrote {target / 'circle.ngc'}")
    before = (target / "circle.ngc").read_bytes()
    assert b"G0Z5\n" in before
    # The same place for two: the second is refused, and the first stays.
    (source / "circle.ngc").write_text(CIRCLE)
    assert converted(watched) == 1
    assert "circle.ngc: its program would overwrite that of circle.json" in capsys.readouterr().err
    assert (target / "circle.ngc").read_bytes() == before


@pytest.mark.parametrize(("dialect", "name"), [("klipper", "circle.gcode"), ("heidenhain", "circle.h")])
def test_the_program_of_a_path_file_has_the_ending_of_its_dialect(dialect, name, folders):
    source, target = folders
    watched = watcher(source, "-o", target, "--strategy", "suppress", "--dialect", dialect)
    shutil.copy(ROOT / "paths" / "circle.json", source)
    assert converted(watched) == 1
    assert [one.name for one in target.iterdir()] == [name]


def test_of_two_for_one_place_neither_takes_that_of_the_other(folders, capsys):
    """Whichever is looked at first: the program of one is not replaced by that of the other."""
    source, target = folders
    (source / "part.ngc").write_text(CIRCLE)
    assert converted(watcher(source, "-o", target)) == 1
    before = (target / "part.ngc").read_bytes()
    shutil.copy(ROOT / "paths" / "circle.json", source / "part.json")
    os.utime(source / "part.json", (0, 0))
    assert converted(watcher(source, "-o", target, "--strategy", "suppress")) == 0
    said = capsys.readouterr().err
    assert "part.json: its program and that of part.ngc would be one file; expected one of them" in said
    assert (target / "part.ngc").read_bytes() == before
    (target / "part.ngc").unlink()
    assert converted(watcher(source, "-o", target, "--strategy", "suppress")) == 0
    assert capsys.readouterr().err.count("would be one file") == 2
    assert not (target / "part.ngc").exists()


def test_what_somebody_else_wrote_is_not_overwritten(folders, capsys):
    source, target = folders
    target.mkdir()
    (target / "part.ngc").write_text("(the only original)\n")
    (source / "part.ngc").write_text(CIRCLE)
    assert converted(watcher(source, "-o", target)) == 0
    assert "part.ngc: is there already, and not written by ph-post" in capsys.readouterr().err
    assert (target / "part.ngc").read_text() == "(the only original)\n"
    assert converted(watcher(source, "-o", target, "--force")) == 1
    assert undo((target / "part.ngc").read_bytes(), "part") == CIRCLE.encode()


def test_started_again_it_knows_what_is_done(folders, capsys):
    source, target = folders
    (source / "part.ngc").write_text(CIRCLE)
    assert converted(watcher(source, "-o", target)) == 1
    assert converted(watcher(source, "-o", target)) == 0
    assert "part.ngc is there already" in capsys.readouterr().err
    # Of another original, or for another machine, it is made anew.
    (source / "part.ngc").write_text(SLOT)
    assert converted(watcher(source, "-o", target)) == 1
    assert converted(watcher(source, "-o", target, machine="router")) == 1
    assert b"worn router" in (target / "part.ngc").read_bytes()


def test_a_file_that_changes_while_it_is_converted_has_its_turn_later(folders, monkeypatch):
    source, target = folders
    part = source / "part.ngc"
    part.write_text(CIRCLE)
    honest = watch.converted

    def slow(raw, *rest):
        if part.read_text() == CIRCLE:
            part.write_text(SLOT)
        return honest(raw, *rest)

    monkeypatch.setattr(watch, "converted", slow)
    watched = watcher(source, "-o", target)
    assert converted(watched, times=1) == 0
    assert not (target / "part.ngc").exists()
    assert converted(watched) == 1
    assert undo((target / "part.ngc").read_bytes(), "part") == SLOT.encode()


@pytest.mark.parametrize("which", ["watched", "programs"])
@pytest.mark.thinned(2)
def test_a_folder_that_vanishes_ends_it_in_a_line(folders, which):
    source, target = folders
    with watching(source, "-o", target) as watched:
        shutil.rmtree(source if which == "watched" else target)
        if which == "programs":
            (source / "part.ngc").write_text(CIRCLE)
        assert watched.end() == 2
    place = f"{source}: the watched folder" if which == "watched" else f"{target}: the folder for the programs"
    assert watched.said[1:] == [f"ph-post: {place} is not there any more"]


def test_what_cannot_be_watched_is_told_in_a_line(folders, tmp_path, capsys):
    source, target = folders
    file = tmp_path / "a file"
    file.write_text("")
    machine = ("-m", "stepper")
    for words, said in [
        ((tmp_path / "none", *machine, "-o", target), "none: no such folder; expected a folder to watch"),
        ((file, *machine, "-o", target), "a file: is no folder; expected a folder to watch"),
        ((source, "-o", target), "Missing option '-m' / '--machine'"),
        ((source, "-m", file, "-o", target), "a file: the file is empty"),
        ((source, *machine, "--dialect", "x", "-o", target), "dialect: no such dialect"),
        ((source, *machine), "--watch needs a place for the programs"),
        ((source, *machine, "-o", target, "--suffix", "_bl"), "--watch needs a place for the programs"),
        ((source, *machine, "-o", source / "."), "the watched folder itself"),
        ((source, *machine, "-o", "-"), "-o needs the name of a folder"),
        ((source, *machine, "-o", file), "a file: the folder cannot be made"),
        ((source, *machine, "--suffix", "a/b"), "--suffix needs an end"),
        ((source, *machine, "-o", target, "--undo"), "--undo does not go with --watch"),
        ((source, *machine, "-o", target, "--json"), "--json does not go with --watch"),
        ((source, *machine, "-o", target, "part.ngc"), "--watch takes a folder in place of IN"),
    ]:
        assert main(["convert", "--watch", *map(str, words)]) == 2
        lines = capsys.readouterr().err.splitlines()
        assert len(lines) == 1
        assert said in lines[0]


def test_ctrl_c_in_compiled_code_ends_the_watch(folders, monkeypatch, capsys):
    # It counted as an error of the file, which was not converted again, and the watch went on.
    source, target = folders
    (source / "part.ngc").write_text(SLOT)

    def break_off(*_arguments, **_named):
        try:
            raise KeyboardInterrupt
        except KeyboardInterrupt as error:
            raise SystemError("CPUDispatcher(...) returned a result with an exception set") from error

    monkeypatch.setattr(watch, "converted", break_off)
    monkeypatch.setattr(watch, "POLL", 0.0)
    assert main(["convert", "--watch", str(source), "-m", "router", "-o", str(target), "--settle", "0.1"]) == 0
    assert capsys.readouterr().err.endswith("stopped; 0 converted, 0 refused\n")
