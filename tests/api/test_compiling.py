"""Compiled code is kept where there is room for it, and needs none: a read-only installation, no home."""

import ctypes
import os
import shutil
import stat
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
import pytest
from numba import config

import ph_post
from ph_post import compiling

PACKAGE = Path(ph_post.__file__).parent
MILL, CIRCLE = (str(PACKAGE.parent / name) for name in ("samples/machines/mill.toml", "paths/circle.json"))
DROP_FROM_BOUNDING_SET, WRITE_ANYWHERE = 24, 1  # prctl(2): PR_CAPBSET_DROP, CAP_DAC_OVERRIDE


def without_privilege():
    """Let the modes of folders count for the superuser too; nothing changes for others."""
    if os.geteuid() == 0:
        ctypes.CDLL(None).prctl(DROP_FROM_BOUNDING_SET, WRITE_ANYWHERE, 0, 0, 0)


@pytest.fixture
def read_only(tmp_path):
    """A copy of the package in which nothing can be written, and a home that cannot be written either."""
    copy, home, temporary = tmp_path / "site", tmp_path / "home", tmp_path / "temporary"
    shutil.copytree(PACKAGE, copy / "ph_post", ignore=shutil.ignore_patterns("__pycache__"))
    home.mkdir()
    temporary.mkdir()
    folders = [copy, home, *(one for one in copy.rglob("*") if one.is_dir())]
    for folder in folders:
        folder.chmod(0o555)
    yield copy, home, temporary
    for folder in folders:
        folder.chmod(0o755)


def run(copy, home, temporary, *arguments):
    kept = {name: os.environ[name] for name in ("PATH", "LD_LIBRARY_PATH") if name in os.environ}
    environment = {**kept, "HOME": str(home), "TMPDIR": str(temporary), "PYTHONPATH": str(copy)}
    return subprocess.run(
        [sys.executable, "-m", "ph_post", *arguments],
        env=environment,
        cwd=temporary,
        preexec_fn=without_privilege,
        capture_output=True,
        text=True,
        check=False,
    )


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="modes of folders are those of POSIX")
def test_a_read_only_installation_without_a_home_works_and_says_where_code_is_kept(read_only):
    copy, home, temporary = read_only
    probe = subprocess.run(
        [sys.executable, "-c", f"open({str(copy / 'ph_post' / 'new')!r}, 'w')"],
        preexec_fn=without_privilege,
        capture_output=True,
        check=False,
    )
    assert b"PermissionError" in probe.stderr  # nothing can be written there, whoever runs this
    command = ("simulate", CIRCLE, "-m", MILL, "--log")
    first = run(copy, home, temporary, *command, "run.csv")
    assert first.returncode == 0, first.stderr
    folder = temporary / f"ph-post-{os.getuid()}"
    assert f"compiling (kept in {folder}: neither the installation nor a home can be written)" in first.stderr
    assert (temporary / "run.csv").stat().st_size > 1000
    assert stat.S_IMODE(folder.stat().st_mode) == 0o700
    assert list(folder.rglob("*.nbc"))  # the code is there, and is not compiled again
    assert not list(copy.rglob("__pycache__"))
    assert not list(home.iterdir())
    second = run(copy, home, temporary, *command, "again.csv")
    assert second.returncode == 0
    assert "compiling" not in second.stderr


def no_locator(*_args):
    """Stand in for numba's look for a place, which finds one only in a folder that is named."""
    if not config.CACHE_DIR:
        raise RuntimeError("cannot cache function: no locator available")


@pytest.mark.parametrize("room", [True, False])
def test_where_numba_finds_no_place_code_is_kept_in_the_temporary_folder_or_nowhere(room, monkeypatch, tmp_path):
    found = str(tmp_path / "code") if room else None
    monkeypatch.setattr(compiling, "_private_folder", lambda: found)
    monkeypatch.setattr(compiling, "_kept", compiling._CachePlace())
    monkeypatch.setattr(config, "CACHE_DIR", "")
    entry = compiling._entry

    def tried(function, *, cache):
        if cache:
            no_locator()
        return entry(function, cache=cache)

    monkeypatch.setattr(compiling, "_entry", tried)

    def double(values):
        return 2.0 * values

    fast = compiling.compiled(double)
    assert fast(np.array([1.5])).tolist() == [3.0]
    assert config.CACHE_DIR == ""
    words = compiling._kept.words
    assert words.startswith(f"kept in {found}" if room else "in every run: no folder")
    assert bool(list(tmp_path.rglob("*.nbi"))) == room


def test_a_folder_to_which_others_can_write_is_not_trusted(monkeypatch, tmp_path):
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    name = tmp_path / f"ph-post-{os.getuid()}"
    assert compiling._private_folder() == str(name)
    assert compiling._private_folder() == str(name)  # it is taken again
    name.chmod(0o777)
    other = compiling._private_folder()
    assert other not in (None, str(name))
    assert stat.S_IMODE(Path(other).stat().st_mode) == 0o700
    name.rmdir()
    name.symlink_to(other)
    assert compiling._private_folder() not in (None, str(name), other)


def test_without_a_temporary_folder_nothing_is_kept(monkeypatch):
    def nowhere():
        raise FileNotFoundError("no usable temporary directory found")

    monkeypatch.setattr(tempfile, "gettempdir", nowhere)
    assert compiling._private_folder() is None
