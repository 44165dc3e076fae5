"""Look for programs that break readers and writers, guided by which lines of them they reach.

Run it by hand, in an environment that has atheris, from the project's folder::

    NUMBA_BOUNDSCHECK=1 NUMBA_CACHE_DIR=CACHE PYTHONPATH=. python tests/fuzz/fuzz_reader.py -max_total_time=300 CORPUS

CORPUS is a folder that keeps what was found to reach further; with nothing in it, it begins with random programs of
every dialect. The first byte of an input says which dialect reads the rest, and whether it is compensated as well,
and written out before. With bounds checked an access outside of an array is an error and not a wrong number.

It ends at the first input that is not kept to the byte, or not refused in one line; of which what is written does not
pass its own check, does not give the input back, or is not the same when it is compensated again; or that takes more
than `-timeout` seconds. That input is written to a file.
"""

from __future__ import annotations

import random
import sys
import warnings
from pathlib import Path

try:
    import atheris
except ImportError:
    sys.exit("skipped: atheris is not installed")

sys.path.insert(0, str(Path(__file__).parents[1]))
COMPILED = [
    ".".join(file.with_suffix("").parts)
    for file in sorted(Path("ph_post").rglob("*.py"))
    if "ph_post.compiling import" in file.read_text(encoding="utf-8")
]
"""Modules of which the compiler takes the functions as they are."""

with atheris.instrument_imports(include=["ph_post"], exclude=[*COMPILED, "ph_post.compiling"]):
    from support import corpus
    from support.mutations import mutated
    from support.random_languages import ENDINGS, LANGUAGES, random_text

    from ph_post.api.compensation import compensated, undo
    from ph_post.api.options import CompensateOptions
    from ph_post.dialects.reading import read_as
    from ph_post.errors import PhPostError
    from ph_post.files.storage import SourceBytes
    from ph_post.progress import no_progress

DIALECTS = list(LANGUAGES)
MACHINES = {dialect: corpus.stepper(dialect) for dialect in DIALECTS}

UNSOUND = "does not pass its own check"
EFFORT = 0.01

WRITES, EXPANDS = 16, 32
"""Bits of the first byte, of which the four below are the number of the dialect."""


def one_input(data: bytes) -> None:
    """Read an input, and compensate it where its first byte says so."""
    if len(data) < 2:
        return
    how, data = data[0], data[1:]
    dialect = DIALECTS[how % 16 % len(DIALECTS)]
    title = f"a{ENDINGS.get(dialect, '.nc')}"
    try:
        program = read_as(dialect, data, title)
        if b"".join(program.text(block) for block in range(program.blocks)) != data:
            raise AssertionError("bytes are lost")
        if how & WRITES:
            write(dialect, title, data, CompensateOptions(expand=bool(how & EXPANDS), effort=EFFORT))
    except PhPostError as refusal:
        if len(str(refusal).splitlines()) != 1 or UNSOUND in str(refusal):
            raise AssertionError(f"refused in more than one line, or not sound: {refusal}") from None


def write(dialect: str, title: str, data: bytes, options: CompensateOptions) -> None:
    """Compensate a program, which may be refused; what is written gives it back and is as good as it gets."""
    source, machine = SourceBytes(name=title, stem="a", data=data), MACHINES[dialect]
    made = compensated(source, machine, options, "program", no_progress).program()
    if made == data:
        return
    after = SourceBytes(name=title, stem="a", data=made)
    try:
        if undo(after) != data:
            raise AssertionError("undo gives another program")
        if compensated(after, machine, options, "program", no_progress).program() != made:
            raise AssertionError("a second run changes the program")
    except PhPostError as refusal:
        raise AssertionError(f"what is written is refused: {refusal}") from None


def another(data: bytes, most: int, seed: int) -> bytes:
    """Damage some lines of an input, or change it as the fuzzer would."""
    rng = random.Random(seed)
    if len(data) < 2 or rng.random() < 0.3:
        return bytes(atheris.Mutate(data, most))
    others = random_text(rng.randrange(10**6)).text.split("\n")
    made, _ = mutated(rng, data[1:].decode("utf-8", "replace"), rng.choice([0.02, 0.1, 0.5]), others)
    return (data[:1] + made)[:most]


def begin(folder: Path) -> None:
    """Put programs into an empty folder, each to be read, to be written, and to be written out and written."""
    for number in range(20 * len(DIALECTS)):
        how = number % len(DIALECTS) + (0, WRITES, WRITES + EXPANDS)[number // len(DIALECTS) % 3]
        (folder / f"{number:03}").write_bytes(bytes([how]) + random_text(number).text.encode())


if __name__ == "__main__":
    warnings.simplefilter("ignore")  # hashes overflow on purpose
    for given in map(Path, sys.argv[1:]):
        if given.is_dir() and not any(given.iterdir()):
            begin(given)
    atheris.Setup(sys.argv, one_input, custom_mutator=another)
    atheris.Fuzz()
