"""Outputs are written whole or not at all."""

import os
import pathlib
import stat
import threading

import pytest

from ph_post.errors import InputError
from ph_post.files import storage
from ph_post.files.storage import check_place, require_folder, write_atomically


def names(folder):
    return sorted(file.name for file in folder.iterdir())


def test_writes_text_and_bytes_and_leaves_nothing_else(tmp_path):
    write_atomically({str(tmp_path / "a.ngc"): "G1 X1\né\n", str(tmp_path / "b.npz"): b"\x00\xff"})
    assert (tmp_path / "a.ngc").read_bytes() == b"G1 X1\n\xc3\xa9\n"
    assert (tmp_path / "b.npz").read_bytes() == b"\x00\xff"
    assert names(tmp_path) == ["a.ngc", "b.npz"]


def test_nothing_to_write():
    write_atomically({})


def test_new_files_have_the_usual_permissions_and_old_ones_keep_theirs(tmp_path):
    new, old, usual = tmp_path / "new", tmp_path / "old", tmp_path / "usual"
    old.write_text("before", encoding="utf-8")
    old.chmod(0o640)
    usual.touch()
    write_atomically({str(new): "x", str(old): "x"})
    assert stat.S_IMODE(old.stat().st_mode) == 0o640
    assert new.stat().st_mode == usual.stat().st_mode


def test_a_link_stays_and_its_target_changes(tmp_path):
    target, link = tmp_path / "target", tmp_path / "link"
    target.write_text("before", encoding="utf-8")
    link.symlink_to(target)
    write_atomically({str(link): "after"})
    assert link.is_symlink()
    assert target.read_text(encoding="utf-8") == "after"


@pytest.mark.parametrize(
    ("bad", "what"),
    [
        ("none/b", r"none/b: cannot be written; expected an existing folder; got .*none"),
        (".", r"\.: is a directory; expected a file to write"),
        ("a/b", r"a/b: cannot be written; expected an existing folder; got .*a"),
        ("x" * 300, r"x+: cannot be written; got File name too long"),
        ("nul\0", r"'nul\\x00': is not a file name; got embedded null"),
    ],
)
def test_a_bad_place_leaves_everything_untouched(tmp_path, monkeypatch, bad, what):
    monkeypatch.chdir(tmp_path)
    pathlib.Path("a").write_text("before", encoding="utf-8")
    with pytest.raises(InputError, match=what):
        write_atomically({"a": "after", "c": "new", bad: "x"})
    assert names(tmp_path) == ["a"]
    assert pathlib.Path("a").read_text(encoding="utf-8") == "before"


def test_a_write_protected_file_is_refused(tmp_path, monkeypatch):
    target = tmp_path / "a"
    target.write_text("before", encoding="utf-8")
    monkeypatch.setattr(os, "access", lambda *_: False)  # root may write anything
    with pytest.raises(InputError, match="got a write-protected file"):
        write_atomically({str(target): "after"})
    assert target.read_text(encoding="utf-8") == "before"


@pytest.mark.parametrize("there", [True, False])
def test_a_write_protected_folder_is_refused_before_the_work_is_done(tmp_path, monkeypatch, there):
    folder, target = tmp_path, tmp_path / "a"
    if there:
        target.write_text("before", encoding="utf-8")
    access = os.access
    monkeypatch.setattr(os, "access", lambda path, mode: pathlib.Path(path) != folder and access(path, mode))
    with pytest.raises(InputError, match="cannot be written; got a write-protected folder"):
        check_place(str(target))
    monkeypatch.setattr(os, "access", lambda path, mode: pathlib.Path(path) != pathlib.Path("/dev"))
    check_place(os.devnull)


def test_two_products_in_one_place_are_refused(tmp_path):
    a = str(tmp_path / "a")
    (tmp_path / "link").symlink_to(a)
    for other in (f"{tmp_path}/./a", str(tmp_path / "link")):
        with pytest.raises(InputError, match="two outputs have the same file"):
            write_atomically({a: "1", other: "2"})
    assert names(tmp_path) == ["link"]


@pytest.mark.parametrize("failing", [0, 1, 2])
def test_a_move_that_fails_undoes_those_before(tmp_path, monkeypatch, failing):
    (tmp_path / "a").write_text("before", encoding="utf-8")
    targets = [str(tmp_path / name) for name in "abc"]
    replace, moves = pathlib.Path.replace, []

    def sometimes(self, target):
        if self.suffix == ".new":
            moves.append(target)
            if len(moves) == failing + 1:
                raise OSError(28, "No space left on device")
        return replace(self, target)

    monkeypatch.setattr(pathlib.Path, "replace", sometimes)
    with pytest.raises(InputError, match="cannot be written; got No space left on device"):
        write_atomically(dict.fromkeys(targets, "after"))
    assert names(tmp_path) == ["a"]
    assert (tmp_path / "a").read_text(encoding="utf-8") == "before"


def test_a_file_system_without_links_still_keeps_the_old_file(tmp_path, monkeypatch):
    def no_links(self, target):
        raise OSError(1, "Operation not permitted")

    monkeypatch.setattr(pathlib.Path, "hardlink_to", no_links)
    (tmp_path / "a").write_text("before", encoding="utf-8")
    write_atomically({str(tmp_path / "a"): "after"})
    assert names(tmp_path) == ["a"]
    assert (tmp_path / "a").read_text(encoding="utf-8") == "after"


def test_standard_output(tmp_path, capfdbinary):
    write_atomically({"-": "t,s\n", str(tmp_path / "a"): "x"})
    assert capfdbinary.readouterr().out == b"t,s\n"
    assert names(tmp_path) == ["a"]


def test_a_closed_pipe_leaves_files_untouched(tmp_path, monkeypatch):
    def broken(_name, _data):
        raise BrokenPipeError

    monkeypatch.setattr(storage, "_send", broken)
    with pytest.raises(BrokenPipeError):
        write_atomically({"-": "t,s\n", str(tmp_path / "a"): "x"})
    assert names(tmp_path) == []


def test_a_device_or_pipe_is_written_to_and_stays_one(tmp_path):
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    got = []
    reader = threading.Thread(target=lambda: got.append(pipe.read_bytes()))
    reader.start()
    write_atomically({str(pipe): "through"})
    reader.join()
    assert got == [b"through"]
    assert stat.S_ISFIFO(pipe.stat().st_mode)
    write_atomically({os.devnull: "nowhere"})
    assert stat.S_ISCHR(pathlib.Path(os.devnull).stat().st_mode)


def test_what_a_killed_run_left_is_not_in_the_way(tmp_path, monkeypatch):
    kept = iter(["aa", "bb"])
    monkeypatch.setattr(storage.secrets, "token_hex", lambda _size: next(kept))
    (tmp_path / f".ph-post-{os.getpid()}-0.new").write_text("half", encoding="utf-8")
    for _ in range(2):
        write_atomically({str(tmp_path / "a"): "whole"})
        assert (tmp_path / "a").read_text(encoding="utf-8") == "whole"


def test_a_disk_that_refuses_the_tidying_up_is_told_as_the_place(tmp_path, monkeypatch):
    def refuse(*_arguments, **_named):
        raise OSError(30, "Read-only file system")

    for name in ("open", "unlink"):
        monkeypatch.setattr(pathlib.Path, name, refuse)
    with pytest.raises(InputError, match="a: cannot be written; got Read-only file system"):
        write_atomically({str(tmp_path / "a"): "x"})


def test_files_are_moved_in_the_order_they_are_given(tmp_path, monkeypatch):
    moved, honest = [], pathlib.Path.replace
    monkeypatch.setattr(pathlib.Path, "replace", lambda self, place: (moved.append(place.name), honest(self, place)))
    write_atomically({str(tmp_path / "b"): "1", str(tmp_path / "a"): "2"})
    assert moved == ["b", "a"]


def test_a_closed_standard_output_is_refused(monkeypatch):
    monkeypatch.setattr("sys.stdout", None)
    with pytest.raises(InputError, match="standard output: cannot be written; got a closed stream"):
        write_atomically({"-": "x"})


def test_a_folder_that_cannot_be_read_is_not_an_empty_one(tmp_path, monkeypatch):
    def refuse(_folder):
        raise PermissionError(13, "Permission denied")

    assert require_folder(tmp_path, "logs") == tmp_path
    monkeypatch.setattr("os.scandir", refuse)
    with pytest.raises(InputError, match="cannot be read; got Permission denied"):
        require_folder(tmp_path, "logs")
