"""Random programs of every dialect, and programs with damaged lines, through the commands: what goes wrong?

A random program is compensated, written out before where it computes. It may be refused in one line and nothing else;
what is written is verified, gives its original back, stays as it is when it is compensated again, and is followed by
interpreters of the tests' own, with a table behind backlash.

Damaged programs go through convert, verify, inspect and diff as commands, within a time: no traceback, nothing
half-written, and what is written is as good. Many more are only read and written out.

    python -m tests.long.fuzz programs --first 0 --count 10000 --rows rows.jsonl
    python -m tests.long.fuzz lines --first 0 --count 20000 --rows lines.jsonl
    python -m tests.long.fuzz readings --first 0 --count 20000 --rows readings.jsonl
    python -m tests.long.fuzz --rows rows.jsonl lines.jsonl readings.jsonl --out tests/long/fuzz.json
"""

from __future__ import annotations

import argparse
import contextlib
import io
import json
import random
import re
import signal
import sys
import tempfile
import time
import traceback
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from functools import cache
from pathlib import Path as File
from typing import Any, NamedTuple

import numpy as np
from scipy.spatial import cKDTree

sys.path.insert(0, str(File(__file__).parents[1]))

from support import corpus, fanuc_player, part_programs
from support.corpus_judge import GAP, axes_of, in_the_work, played_places, table_of
from support.mutations import mutated
from support.random_languages import ENDINGS, LANGUAGES, RandomText, random_text
from support.streams import without_progress

from ph_post.api.checks import verify
from ph_post.api.compensation import compensated, undo
from ph_post.api.expansion import before_expansion, expanded_job
from ph_post.api.options import CompensateOptions
from ph_post.cli.main import main as command
from ph_post.dialects.reading import read_as
from ph_post.errors import PhPostError
from ph_post.files.storage import SourceBytes
from ph_post.gcode.program import ARC, RAPID, PartProgram
from ph_post.progress import no_progress

PROGRAMS = 10_000
SEED = 1809

MOST, LARGEST = 300, 20_000
"""Lines of a program that is damaged, and bytes of the largest of the corpus, at most."""

PARTS = (0.03, *3 * (0.3, 0.6, 0.9))
"""Parts of the lines that are damaged: with few in a program most of the time goes into what is whole."""

MACHINES = (*9 * ("stepper",), "router")

TOO_LONG = 60.0
"""Time of the processor [s] after which a step counts as one without end."""

SAMPLED = 0.0072
"""Places that the interpreters sample are off the path by less [mm]: a corner between two that are 0.02 mm apart is
0.02 / sqrt(8) mm beside the chord."""

TAKEN_UP = 3.0 * GAP
"""Distance [mm] from the way of the original within which every motor stays."""

UNSOUND = "does not pass its own check"
"""What a program is refused for that was compensated wrongly."""

EFFORT = 0.01
"""Of the search for a plan."""

PIECE = 0.05
"""Longest piece of a way [mm], and `NEAR` how many of them are looked at from a place."""

NEAR = 12

CLOSELY = 256
"""Places that are looked at closely at a time, and [mm] what a distance is computed to."""

ROUNDING = 1e-9

BESIDE = 1e-3
"""Distance [mm] by which a place is nearer to a way in the air than to the path, where it is no cut."""

_END = re.compile(r"^(?!\s*[;(]).*\bM0*(?:2|30)\b", re.IGNORECASE)
_ENDS = re.compile(_END.pattern + r"|^\s*(?:\d+\s+)?(?:BEGIN|END)\s+PGM|^\s*%", re.IGNORECASE)
_OFFSET = re.compile(r"offset [XYZ] [-+]?([\d.]+) mm", re.IGNORECASE)
_WITHIN = re.compile(r"within ([\d.]+) mm", re.IGNORECASE)


class Tried(NamedTuple):
    """A trial: `faults` are what went wrong, `lines` the damaged ones, `seconds` those of the processor."""

    kind: str
    number: int
    dialect: str
    name: str
    outcome: str
    faults: tuple[str, ...]
    lines: int
    seconds: float


class Endless(BaseException):
    """A step took longer than `TOO_LONG`."""


@contextlib.contextmanager
def within_time() -> Iterator[None]:
    """End what takes too long on the processor, as soon as it is back in Python."""

    def ring(*_: object) -> None:
        raise Endless

    before = signal.signal(signal.SIGVTALRM, ring)
    signal.setitimer(signal.ITIMER_VIRTUAL, TOO_LONG)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_VIRTUAL, 0.0)
        signal.signal(signal.SIGVTALRM, before)


def where(error: BaseException) -> str:
    """Kind of an error, and the last lines of the package that it came through."""
    own = [one for one in traceback.extract_tb(error.__traceback__) if "ph_post" in one.filename]
    places = " < ".join(f"{File(one.filename).name}:{one.lineno}" for one in own[:-4:-1])
    return f"{type(error).__name__}: {str(error)[:120]} ({places})"


def try_program(number: int) -> Tried:
    """Compensate a random program, and look at what comes of it."""
    job = random_text(number)
    return _tried("programs", number, job.dialect, job.kind, 0, lambda: _outcome(job))


def _tried(
    kind: str, number: int, dialect: str, name: str, lines: int, outcome_of: Callable[[], tuple[str, list[str]]]
) -> Tried:
    """Ask for the outcome and the faults of a trial, which may fail itself, or never end."""
    begun, faults, outcome = time.process_time(), [], "failed"
    try:
        with within_time():
            outcome, faults = outcome_of()
    except (Exception, Endless) as error:
        faults = [where(error)]
    return Tried(kind, number, dialect, name, outcome, tuple(faults), lines, time.process_time() - begun)


def _outcome(job: RandomText) -> tuple[str, list[str]]:
    title = f"part{ENDINGS.get(job.dialect, '.nc')}"
    source = SourceBytes(name=title, stem="part", data=job.text.encode())
    machine = corpus.stepper(job.dialect)
    options = CompensateOptions(expand=True, effort=EFFORT)
    try:
        result = compensated(source, machine, options, "program", no_progress)
        data = result.program()
    except PhPostError as error:
        return "refused", [f"refused: {error}"]
    faults = []
    if "computed" in job.kind and not result.expanded:
        faults.append(f"not written out: {' '.join(result.warnings)[:200]}")
    outcome = "unchanged" if data == source.data else "expanded" if result.expanded else "compensated"
    if data != source.data:
        made = SourceBytes(name=title, stem="part", data=data)
        original, after = (read_as(job.dialect, one, title) for one in (result.original.data, data))
        verdict = verify(original, after, machine)
        faults += [f"verify: {failure.sentence()}" for failure in verdict.failures]
        faults += ["undo gives another program"] if undo(made) != source.data else []
        again = compensated(made, machine, options, "program", no_progress).program()
        faults += ["a second run changes the program"] if again != data else []
    return outcome, [*faults, *_followed(job, result.original.data, data)]


def _followed(job: RandomText, original: bytes, data: bytes) -> list[str]:
    """Say where interpreters of the tests find another way than that of the program without loops."""
    faults: list[str] = []
    meant, found = (played_places(job.dialect, _to_end(one)) for one in (job.plain.encode(), data))
    if meant is None or found is None:
        return ["no interpreter of the tests plays it"]
    path, air = (Way(_dense(meant[0], rows)) for rows in (meant[1], ~meant[1]))
    program = read_as(job.dialect, original, "part.nc")
    own = Way(_reader_places(program))
    if len(path) and len(own):
        faults += _far("the reader's path", path.farthest(own.ends), SAMPLED)
        faults += [] if program.notes else _far("what the reader misses", own.farthest(path.ends), SAMPLED)
    if not len(path):
        return faults
    text = data.decode("latin-1")
    shift = float(np.linalg.norm([float(size) for size in _OFFSET.findall(text)]))
    left = max(map(float, _WITHIN.findall(text)), default=0.0)
    motor, after = (Way(_dense(places, np.ones_like(cutting))) for places, cutting in (meant, found))
    faults += _far("a motor", motor.farthest(after.ends), TAKEN_UP + shift)
    if not len(_dense(*found)):
        return [*faults, "no cuts are left"]
    faults += _far("what is not cut", after.farthest(path.ends), shift + left + SAMPLED)
    axes, cutting = axes_of(job.dialect, data), [in_the_work(one, meant) for one in (meant, found)]
    for side in (-1.0, 1.0):
        plain, led = (_table_away(one, (path, air), side, axes) for one in cutting)
        faults += _far("the table", led, plain + left + SAMPLED)
    return faults


def _to_end(data: bytes) -> bytes:
    """Leave out what stands behind the end of a program."""
    lines = data.decode("latin-1").splitlines()
    last = next((n for n, line in enumerate(lines) if _END.search(line)), len(lines))
    return "\n".join([*lines[: last + 1], ""]).encode()


def _dense(places: np.ndarray, cutting: np.ndarray) -> np.ndarray:
    """Pieces (n, 2, 3) of a way [mm] no longer than `PIECE`, of the moves that cut."""
    begin, end = places[:-1], places[1:]
    rows = np.flatnonzero(cutting[1:] & ~np.isnan(begin + end).any(axis=1))
    return _pieces(begin[rows], end[rows])


def _pieces(begin: np.ndarray, end: np.ndarray) -> np.ndarray:
    count = np.maximum(np.ceil(np.linalg.norm(end - begin, axis=1) / PIECE), 1.0).astype(np.int64)
    row = np.repeat(np.arange(count.size), count)
    number = np.arange(row.size) - np.repeat(np.cumsum(count) - count, count)
    share = np.column_stack([number, number + 1]) / count[row][:, None]
    return begin[row][:, None] + share[..., None] * (end - begin)[row][:, None]


def _reader_places(program: PartProgram) -> np.ndarray:
    """Pieces of the cuts that the package reads, from its record of motions."""
    kind = program.motions.kind
    points, owner = part_programs.samples(program, 240 if (kind == ARC).any() else 2)
    points, begins = 1e3 * points, np.diff(owner, prepend=-1) != 0
    way = np.cumsum(np.linalg.norm(np.diff(points, axis=0, prepend=points[:1]), axis=1))
    kept = begins | np.append(begins[1:], True) | (np.diff(way // (0.5 * PIECE), prepend=0.0) != 0.0)
    points, owner = points[kept], owner[kept]
    rows = np.flatnonzero((owner[1:] == owner[:-1]) & (kind[owner[1:]] != RAPID))
    return _pieces(points[rows], points[rows + 1])


class Way:
    """A way in `pieces` (n, 2, 3) [mm], from which places may be far."""

    def __init__(self, pieces: np.ndarray) -> None:
        self.pieces, self.ends = pieces, pieces[:, 1]
        self.tree = cKDTree(pieces.mean(axis=1)) if len(pieces) else None

    def __len__(self) -> int:
        return len(self.pieces)

    def away(self, points: np.ndarray, near: int = NEAR) -> np.ndarray:
        """Distances [mm] of points from those pieces, `near` in number, of which the middles are nearest."""
        assert self.tree is not None
        rows = self.tree.query(points, min(near, len(self)))[1].reshape(len(points), -1)
        begin, way = self.pieces[rows, 0], self.pieces[rows, 1] - self.pieces[rows, 0]
        square = np.maximum((way * way).sum(axis=-1), 1e-30)
        share = np.clip(((points[:, None] - begin) * way).sum(axis=-1) / square, 0.0, 1.0)
        return np.linalg.norm(begin + share[..., None] * way - points[:, None], axis=-1).min(axis=1)

    def farthest(self, points: np.ndarray, counts: Callable[[np.ndarray], np.ndarray] | None = None) -> float:
        """Largest distance [mm] of points from the way, of those of whose numbers `counts` says that they count.

        No point is farther than the piece whose middle is nearest: those are looked at closely, the farthest first,
        that may be farther than what was found.
        """
        bound, worst = self.away(points, 1), 0.0
        order = np.argsort(-bound)
        for rows in np.split(order, range(CLOSELY, len(order), CLOSELY)):
            if not rows.size or bound[rows[0]] <= worst + ROUNDING:
                break
            kept = rows if counts is None else rows[counts(rows)]
            worst = max(worst, float(self.away(points[kept]).max(initial=0.0)))
        return worst


def _table_away(played: tuple[np.ndarray, np.ndarray], ways: tuple[Way, Way], side: float, axes: str) -> float:
    """Largest distance [mm] of the table from the path where motors cut, and do not take up backlash in the air.

    `ways` are the path and what the original does in the air.
    """
    (places, cutting), (path, air) = played, ways
    rows = cutting & ~np.isnan(places).any(axis=1)
    motor, table = places[rows], table_of(places, side, axes)[rows]

    def in_the_cut(some: np.ndarray) -> np.ndarray:
        return path.away(motor[some]) < air.away(motor[some]) + BESIDE

    return path.farthest(table, in_the_cut if len(air) else None)


def _far(what: str, worst: float, least: float) -> list[str]:
    return [f"{what} is {1e3 * worst:.1f} µm off, expected {1e3 * least:.1f}"] if worst > least else []


@cache
def _entries() -> list[corpus.Entry]:
    """Programs of the corpus that are damaged."""
    return [entry for entry in corpus.whole() if len(entry.data) <= LARGEST]


def _whole_program(rng: random.Random) -> tuple[str, str, str]:
    """Dialect, text and name of a program to damage."""
    kind, number = rng.random(), rng.randrange(10**6)
    if kind < 0.55:
        entry = rng.choice(_entries())
        return entry.dialect, entry.data.decode("utf-8", "replace"), entry.name
    if kind < 0.85:
        job = random_text(number)
        return job.dialect, job.text, f"{job.kind} {number}"
    if kind < 0.92:
        return "linuxcnc", part_programs.random_program(random.Random(number)).decode(), f"part {number}"
    return "fanuc", fanuc_player.random_program(random.Random(number)), f"fanuc {number}"


def _joined(rng: random.Random, dialect: str, text: str) -> str:
    """A program with others of its dialect behind it, as if none of them ended."""
    number, own = (
        list(LANGUAGES).index(dialect.partition("+")[0]),
        [one for one in _entries() if one.dialect == dialect],
    )
    lines = text.split("\n")
    while len(lines) < MOST:
        if own and rng.random() < 0.5:
            more = rng.choice(own).data.decode("utf-8", "replace")
        else:
            more = random_text(number + len(LANGUAGES) * rng.randrange(10**5)).text
        lines = [*(line for line in lines if not _ENDS.search(line)), *more.split("\n")]
    return "\n".join(lines[:MOST])


class Damaged(NamedTuple):
    """A program of a dialect before and after `lines` of it were damaged, and a drawer of what is done with it."""

    dialect: str
    name: str
    text: str
    data: bytes
    lines: int
    rng: random.Random


def damaged(number: int) -> Damaged:
    """Draw the damaged program of a number."""
    rng = random.Random(f"damaged {number}")
    dialect, text, name = _whole_program(rng)
    text = _joined(rng, dialect, text) if rng.random() < 0.7 else "\n".join(text.split("\n")[:MOST])
    data, count = mutated(rng, text, rng.choice(PARTS), _whole_program(rng)[1].split("\n"))
    dialect = rng.choice(list(LANGUAGES)) if rng.random() < 0.05 else dialect
    return Damaged(dialect, name, text, data, count, rng)


class _Commands:
    """Runs commands in a folder, and keeps what goes wrong."""

    def __init__(self) -> None:
        self.faults: list[str] = []

    def run(self, *words: object) -> tuple[int | None, str]:
        """Run a command; return its status, None where it did not end well, and what it says."""
        out, err = (io.TextIOWrapper(io.BytesIO(), "utf-8", newline="") for _ in range(2))
        name = str(words[0])
        try:
            with within_time(), contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
                status = command([str(word) for word in words])
        except (Exception, Endless) as error:
            self.faults.append(f"{name}: {where(error)}")
            return None, ""
        said = []
        for stream in (out, err):
            stream.flush()
            said.append(stream.buffer.getvalue().decode())
        told = without_progress(said[1])
        own = [line for line in told.split("\n") if line.startswith("ph-post: ")]
        if "internal error" in told:
            self.faults.append(f"{name}: {own[-1][:200]}")
            return None, ""
        if status not in (0, 1, 2) or (status == 2 and (len(own) != 1 or not told.startswith(own[0]))):
            self.faults.append(f"{name}: status {status}, {told[:200]!r}")
        return status, "".join(said)

    def expect(self, what: str, holds: bool) -> None:
        """Keep what does not hold."""
        if not holds:
            self.faults.append(what)


def try_damaged(number: int) -> Tried:
    """Take a damaged program through the commands."""
    job, done = damaged(number), _Commands()
    begun = time.process_time()
    with tempfile.TemporaryDirectory() as name:
        outcome = _taken(job, File(name), done)
    spent = time.process_time() - begun
    return Tried("lines", number, job.dialect, job.name, outcome, tuple(done.faults), job.lines, spent)


def _taken(job: Damaged, folder: File, done: _Commands) -> str:
    ending, choose = ENDINGS.get(job.dialect, ".nc"), job.rng.choice
    source, out, back, again, plain = (folder / f"{name}{ending}" for name in ("a", "out", "back", "again", "plain"))
    source.write_bytes(job.data)
    reading = ["-m", choose(MACHINES), "--dialect", job.dialect]
    how = [*reading, "--effort", EFFORT, *choose([(), ("--expand",)]), *choose([(), *5 * [("--no-simulation",)]])]
    status, said = done.run("convert", source, *how, "-o", out)
    done.expect(said[:300], UNSOUND not in said)
    if status != 0:
        done.expect("a command that fails leaves a file", [one.name for one in folder.iterdir()] == [source.name])
        outcome = "refused"
    elif (made := out.read_bytes()) == job.data:
        outcome = "unchanged"
    else:
        outcome = "expanded" if b"ph-post-expand" in made.lower() else "compensated"
        status, said = done.run("verify", source, out, *reading)
        done.expect(f"verify: {said[:300]}", status == 0)
        status, _ = done.run("convert", out, "--undo", "-o", back)
        done.expect("undo gives another program", status == 0 and back.read_bytes() == job.data)
        status, _ = done.run("convert", out, *how, "-o", again)
        done.expect("a second run changes the program", status == 0 and again.read_bytes() == made)
    done.run("inspect", source, *reading, "--json")
    plain.write_text(job.text, encoding="utf-8")
    other = out if out.exists() and choose([True, False]) else plain
    done.run("diff", other, source, "--dialect", job.dialect, "--json", *choose([(), tuple(reading[:2])]))
    return outcome


def try_reading(number: int) -> Tried:
    """Read a damaged program, and write it out."""
    job = damaged(number)
    return _tried("readings", number, job.dialect, job.name, job.lines, lambda: read_and_expanded(job))


def read_and_expanded(job: Damaged) -> tuple[str, list[str]]:
    """Read a program, and write it out; what came of it, and what was wrong."""
    title, faults, outcome = f"a{ENDINGS.get(job.dialect, '.nc')}", [], "read"
    try:
        program = read_as(job.dialect, job.data, title)
        faults += [] if b"".join(map(program.text, range(program.blocks))) == job.data else ["bytes are lost"]
        source = SourceBytes(name=title, stem="a", data=job.data)
        made = expanded_job(source, job.dialect, CompensateOptions(expand=True))[0].data
        if made != job.data:
            outcome = "unsound"
            faults += [] if before_expansion(made, title) == job.data else ["the original is not kept"]
            read_as(job.dialect, made, title)
            outcome = "expanded"
    except PhPostError as refusal:
        told = str(refusal)
        faults += [] if len(told.splitlines()) == 1 else [f"more than one line: {told[:200]!r}"]
        faults += [f"what is written out is refused: {told}"] if outcome == "unsound" else []
        outcome = "refused"
    return outcome, faults


TRIALS = {"programs": try_program, "lines": try_damaged, "readings": try_reading}
"""Trials by kind."""


def described(one: Tried) -> str:
    """Say in a line what was found."""
    what = f"{one.kind} {one.number} [{one.dialect}] {one.name}: {one.outcome}, {one.seconds:.1f} s"
    return "; ".join([what, *one.faults])


def summary(tried: Sequence[Tried], code: str) -> dict[str, Any]:
    """Counts of what was tried, what came of it, and the numbers of those in which something went wrong."""
    found: dict[str, Any] = {"code": code, "seed": SEED, "seconds a step may take": TOO_LONG}
    for kind in TRIALS:
        rows = {one.number: one for one in tried if one.kind == kind}.values()
        found[kind] = {
            "programs": len(rows),
            "damaged lines": sum(one.lines for one in rows),
            "numbers": [min((one.number for one in rows), default=0), max((one.number for one in rows), default=0)],
            "dialects": dict(sorted(Counter(one.dialect for one in rows).items())),
            "outcomes": dict(sorted(Counter(one.outcome for one in rows).items())),
            "processor [s]": round(sum(one.seconds for one in rows)),
            "longest [s]": round(max((one.seconds for one in rows), default=0.0), 1),
            "faults": [described(one) for one in rows if one.faults],
        }
    return found


def main() -> None:
    """Try many programs, add a row for each, and write the summary of all rows."""
    asked = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    asked.add_argument("kind", nargs="?", choices=list(TRIALS))
    asked.add_argument("--first", type=int, default=0)
    asked.add_argument("--count", type=int, default=PROGRAMS)
    asked.add_argument("--step", type=int, default=1)
    asked.add_argument(
        "--rows", type=File, nargs="+", required=True, help="a line of JSON a trial; new ones go to the first"
    )
    asked.add_argument("--out", type=File)
    asked.add_argument("--code", default="", help="the commit of what was tried")
    given = asked.parse_args()
    if given.kind:
        for number in range(given.first, given.first + given.count, given.step):
            one = TRIALS[given.kind](number)
            if one.faults:
                sys.stdout.write(f"BAD {described(one)}\n")
                sys.stdout.flush()
            with given.rows[0].open("a", encoding="utf-8") as file:
                file.write(json.dumps(one._asdict()) + "\n")
    rows = [json.loads(line) for file in given.rows for line in file.read_text(encoding="utf-8").splitlines()]
    text = (
        json.dumps(summary([Tried(**{**row, "faults": tuple(row["faults"])}) for row in rows], given.code), indent=1)
        + "\n"
    )
    sys.stdout.write(text)
    if given.out:
        given.out.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
