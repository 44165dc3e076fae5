"""Compiled code is kept while it is true, where there is room for it, and compiled once; it needs no room."""

import ctypes
import importlib
import importlib.util
import os
import pkgutil
import shutil
import stat
import subprocess
import sys
import tempfile
import threading
import types
from pathlib import Path

import numpy as np
import pytest
from numba import config, njit
from numba.core.errors import NumbaError

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


@compiling.lean
def _first(values):
    return values[0]


@compiling.lean
def _view(values):
    return values[1:]


@compiling.inner
def _made(values):
    return np.zeros(values.size)


@compiling.lean
def _asks(values):
    return _made(values).size


def test_lean_functions_count_no_references():
    @njit
    def whole(values):
        return _first(values[1])

    assert whole(np.arange(6.0).reshape(2, 3)) == 3.0
    (made,) = _first.overloads.values()
    assert "NRT_" not in made.library.get_llvm_str()


@pytest.mark.parametrize("function", [_view, _asks])
def test_a_lean_function_that_would_have_to_count_references_is_refused(function):
    @njit
    def whole(values):
        return function(values)

    with pytest.raises((NumbaError, TypeError), match=r"cannot be lean|returning of array"):
        whole(np.arange(6.0))


TOYS = {
    "toy_numbers": "import numpy as np\nSCALE = 3.0\nTABLE = np.array([1.0, 2.0])\nDEEP = (1, (2.0, 5))\n",
    "toy_inner": """
from ph_post.compiling import inner
from toy_numbers import TABLE

@inner
def shifted(x):
    return x + TABLE[1]
""",
    "toy": """
import toy_inner
from ph_post.compiling import compiled
from toy_inner import shifted
from toy_numbers import DEEP, SCALE

OWN = DEEP[1][1]

@compiled
def part(x):
    return shifted(x) * SCALE

@compiled
def whole(x):
    return part(x) + OWN
""",
}


@pytest.fixture
def toy(tmp_path, monkeypatch):
    """Files with compiled functions, written to a folder, and a way to load them as a new process does."""
    for name, text in TOYS.items():
        (tmp_path / f"{name}.py").write_text(text)
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.setattr(sys, "dont_write_bytecode", True)

    def load():
        for name in TOYS:
            sys.modules.pop(name, None)
        importlib.invalidate_caches()
        return importlib.import_module("toy")

    yield load
    for name in TOYS:
        sys.modules.pop(name, None)


def compiled_anew(function):
    return sum(function.stats.cache_misses.values())


@pytest.mark.parametrize(
    ("file", "old", "new", "answer"),
    [
        ("toy_numbers", "SCALE = 3.0", "SCALE = 4.0", (1 + 2) * 4 + 5),
        ("toy_numbers", "[1.0, 2.0]", "[1.0, 2.5]", (1 + 2.5) * 3 + 5),  # a number of a file that a file uses
        ("toy_numbers", "(2.0, 5)", "(2.0, 6)", (1 + 2) * 3 + 6),
        ("toy_inner", "x + TABLE", "x - TABLE", (1 - 2) * 3 + 5),
        ("toy", "* SCALE", "/ SCALE", (1 + 2) / 3 + 5),
    ],
)
def test_code_is_used_again_until_anything_that_is_in_it_changes(file, old, new, answer, toy, tmp_path):
    first = toy()
    assert first.whole(1.0) == (1 + 2) * 3 + 5
    assert compiled_anew(first.whole) == 1
    again = toy()
    assert again.whole(1.0) == (1 + 2) * 3 + 5
    assert compiled_anew(again.whole) == 0
    text = TOYS[file]
    assert text.count(old) == 1
    (tmp_path / f"{file}.py").write_text(text.replace(old, new))
    changed = toy()
    assert changed.whole(1.0) == pytest.approx(answer, rel=1e-15)
    assert compiled_anew(changed.whole) == 1


def test_code_that_checks_bounds_is_other_code(toy, tmp_path, monkeypatch):
    assert toy().whole(1.0) == 14.0
    monkeypatch.setattr(config, "CACHE_DIR", str(tmp_path / "checked"))
    monkeypatch.setattr(config, "BOUNDSCHECK", 1)
    checked = toy()
    assert checked.whole(1.0) == 14.0
    assert compiled_anew(checked.whole) == 1


def test_nothing_that_compiled_code_takes_from_elsewhere_is_missed():
    """Whatever a compiled function names is a number, a table, a compiled function, or no part of this package."""
    named = {}
    for found in pkgutil.walk_packages(ph_post.__path__, "ph_post."):
        spec = importlib.util.find_spec(found.name)
        if ".data." in found.name or "from ph_post.compiling" not in Path(spec.origin).read_text():
            continue
        for one in list(vars(importlib.import_module(found.name)).values()):
            if code := getattr(getattr(one, "py_func", None), "__code__", None):
                scope = one.py_func.__globals__
                named |= {(scope["__name__"], name): scope[name] for name in code.co_names if name in scope}
    assert len(named) > 300
    for place, value in sorted(named.items(), key=str):
        foreign = callable(value) and not str(value.__module__).startswith("ph_post.")
        assert (
            compiling._fact(value) is not None
            or hasattr(value, "py_func")
            or isinstance(value, types.ModuleType)
            or foreign
        ), place


@pytest.mark.skipif(sys.platform == "win32", reason="there nobody waits")
def test_of_two_processes_one_compiles_and_the_other_waits_for_it(toy, tmp_path, monkeypatch, capsys):
    other = subprocess.Popen(
        [
            sys.executable,
            "-c",
            "import sys, toy; from pathlib import Path; from ph_post import compiling\n"
            "with compiling._alone(Path(toy.__file__)):\n"
            "    print('begun', flush=True)\n"
            "    sys.stdin.readline()\n"
            "    print(toy.whole(1.0))\n",
        ],
        env={**os.environ, "PYTHONPATH": os.pathsep.join([str(tmp_path), str(PACKAGE.parent)])},
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    assert other.stdout.readline() == "begun\n"
    refused, lock = threading.Event(), compiling._lock

    def tried(file):
        had = lock(file)
        if not had:
            refused.set()
        return had

    monkeypatch.setattr(compiling, "_lock", tried)
    found = toy()
    answers = []
    waiting = threading.Thread(target=lambda: answers.append(found.whole(1.0)))
    waiting.start()
    assert refused.wait(60)
    assert not answers
    out, _ = other.communicate("now\n", timeout=60)
    waiting.join(60)
    assert answers == [14.0]
    assert out == "14.0\n"
    assert compiled_anew(found.whole) == 0


def test_a_process_that_never_ends_is_not_waited_for(toy, tmp_path, monkeypatch):
    monkeypatch.setattr(compiling, "_lock", lambda _file: False)
    monkeypatch.setattr(compiling, "LONGEST_WAIT", 0.1)
    assert toy().whole(1.0) == 14.0


def test_what_the_installation_brings_is_found_where_it_cannot_be_written(toy, tmp_path, monkeypatch):
    assert toy().whole(1.0) == 14.0  # as while the package is built
    monkeypatch.setattr(config, "CACHE_DIR", str(tmp_path / "home"))
    found = toy()
    assert found.whole(1.0) == 14.0
    assert compiled_anew(found.whole) == 0
    assert found.whole(2) == 17.0  # of another type, which nobody had needed
    assert compiled_anew(found.whole) == 1
    assert list((tmp_path / "home").rglob("*.nbc"))


@pytest.fixture
def hook(monkeypatch, tmp_path):
    """The build's hook in a folder whose package compiles one function, and a list of what it warns of."""

    class Interface:
        def __class_getitem__(cls, _):
            return cls

    plugin = types.ModuleType("hatchling.builders.hooks.plugin.interface")
    plugin.BuildHookInterface = Interface
    for name in ("hatchling", "hatchling.builders", "hatchling.builders.hooks", "hatchling.builders.hooks.plugin"):
        monkeypatch.setitem(sys.modules, name, types.ModuleType(name))
    monkeypatch.setitem(sys.modules, plugin.__name__, plugin)
    spec = importlib.util.spec_from_file_location("hatch_build", PACKAGE.parent / "hatch_build.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    package = tmp_path / "clone" / "ph_post"
    package.mkdir(parents=True)
    (package / "__init__.py").write_text("")
    (package / "double.py").write_text("import numba\n@numba.njit(cache=True)\ndef double(x):\n    return 2 * x\n")
    (package / "__main__.py").write_text("import sys\nfrom ph_post.double import double\ndouble(int(sys.argv[1]))\n")
    one, warnings = module.CompilingHook(), []
    one.root, one.app = str(tmp_path / "clone"), types.SimpleNamespace(display_warning=warnings.append)
    return module, one, package, warnings


@pytest.mark.parametrize("version", ["standard", "editable"])
def test_a_build_brings_compiled_code(version, hook, monkeypatch):
    module, one, package, warnings = hook
    monkeypatch.setattr(module, "COMMANDS", ("1",))
    build = {"force_include": {}}
    one.initialize(version, build)
    beside = {f"ph_post/__pycache__/{file.name}" for file in package.rglob("*.nb[ic]")}
    brought = {inside for file, inside in build["force_include"].items() if Path(file).stat().st_size > 100}
    stem = "ph_post/__pycache__/double.double-2.py{}{}{}".format(*sys.version_info[:2], getattr(sys, "abiflags", ""))
    named = {f"{stem}.nbi", f"{stem}.1.nbc"}
    assert (beside, brought) == ((named, set()) if version == "editable" else (set(), named))
    one.finalize(version, build, "")
    assert not any(Path(file).exists() for file in build["force_include"])
    assert warnings == []


def test_a_build_that_cannot_compile_says_so_and_goes_on(hook, monkeypatch):
    module, one, _, warnings = hook
    monkeypatch.setattr(module, "COMMANDS", ("no-number",))
    one.initialize("standard", {"force_include": {}})
    (said,) = warnings
    assert "not all code is compiled in advance" in said
    assert "invalid literal for int() with base 10: 'no-number'" in said


def test_the_commands_of_a_build_are_those_of_this_package(hook):
    module, *_ = hook
    for command in module.COMMANDS:
        words = command.split()
        assert words[0] == "convert"
        assert all((PACKAGE.parent / word).is_file() for word in words if "/" in word)
