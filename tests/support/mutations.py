"""Part programs with damaged lines: deleted, doubled, swapped, cut, with odd characters, numbers and lengths."""

from __future__ import annotations

import random
import re
from collections.abc import Callable, Sequence

FRAGMENTS = """
G0 G1 G2 G3 X Y1.5 Z-2 I5 J-.5 R3 R-3 F100 F0 F-5 S0 ( ) ; % / #1 #<a> [ ] = O100 O<a> sub endsub call while if
else repeat return M2 M30 M98 M99 P100 L3 *71 @1 ^2 $H G91 G20 G5 G5.2 G5.3 Q1 - . + 99999999999999999999 ,R1
ABS[ SQRT[ G92 G41 G40 D1 G81 G83 G80 G98 G99 A5 U1 G18 G19 K0 G93 G95 G28 G30 G10 T1 M6 G4 G53 G54 G68 G69
G51 G50 G65 G90.1 G61 G64 WHILE[1EQ1]DO1 END1 GOTO10 IF[#1GT0]THEN CR=5 AC(5) IC(-1) TURN=2 CIP I1=1 R1=R1+1
REPEAT ENDREPEAT FOR ENDFOR LOOP ENDLOOP GOTOB GOTOF TRANS ROT AROT POLY PO[X]=(1,2,3) BSPLINE CYCLE81( MCALL
MSG("a") DIAMON G641 BEGIN PGM END MM INCH L C CR CC CP CT RND CHF APPR DEP FMAX FQ1 IX+1 IPA+360 IPR PR+5 PA+30
DR+ DR- RL RR R0 M91 M92 CALL LBL REP CYCL DEF 200 TOOL FN 9: EQU +Q1 Q201=-5 TRANS DATUM FRAC SIN 1/0 G70 G71
G79 G98 H+30 * N10 ~ \\ " ' ~~ G17 G21 M3 M4 M5 M0 M117 M109 M205 SET_VELOCITY_LIMIT EXCLUDE_OBJECT {a} <b>
nan inf
"""
WORDS = FRAGMENTS.split()

SEVERE = (b"\0", 60_000 * b"1", b" E3 ", b"\n(ph-post: offset X 1 mm)\n", b"(ph-post-expand: undo 1/1 a)")
"""What has a whole program refused."""

ODD = "\t\r\x0b\x0c\x1b\x85\xa0²¹°µÄß–−“”　０１９𝟘２Ｘ٣\u2028\ufeff🙂"
NUMBER = re.compile(r"[-+]?\d*\.?\d+")
WORD = re.compile(r"[A-Za-z]+[=]?[-+]?[\d.]*|\S")


def _flip(rng: random.Random, line: str) -> str:
    at = rng.randrange(len(line))
    return line[:at] + chr(rng.randrange(32, 127)) + line[at + 1 :]


def _drop(rng: random.Random, line: str) -> str:
    at = rng.randrange(len(line))
    return line[:at] + line[at + rng.choice([1, 1, 2, 5]) :]


def _insert(rng: random.Random, line: str) -> str:
    at = rng.randrange(len(line) + 1)
    blank = rng.choice(["", " "])
    return line[:at] + blank + rng.choice(WORDS) + blank + line[at:]


def _odd(rng: random.Random, line: str) -> str:
    at = rng.randrange(len(line) + 1)
    return line[:at] + rng.choice(ODD) * rng.choice([1, 1, 3]) + line[at:]


def _number(rng: random.Random, line: str) -> str:
    found = list(NUMBER.finditer(line))
    if not found:
        return _insert(rng, line)
    one = rng.choice(found)
    bare = one[0].lstrip("+-") or "0"
    other = rng.choice(
        [
            bare + rng.choice(["0", "000", "0" * 9, "0" * 25, "0" * 330]),
            "0." + "0" * rng.choice([1, 3, 9, 330]) + bare.replace(".", ""),
            "-" + bare,
            "0",
            "-0",
            "." + bare,
            bare + ".",
            bare + "." + bare,
            bare + "e5",
            "--" + bare,
            str(rng.randint(-9999, 9999) / 1000),
            str(rng.randint(-2000, 2000)),
            "9" * rng.choice([5, 10, 19, 40, 5000]),
            "#1",
            "[1/0]",
            "nan",
            "1/3",
        ]
    )
    return line[: one.start()] + other + line[one.end() :]


def _cut(rng: random.Random, line: str) -> str:
    found = list(WORD.finditer(line))
    if not found:
        return ""
    one = rng.choice(found)
    return line[: one.start()] + line[one.end() :]


def _double_word(rng: random.Random, line: str) -> str:
    found = list(WORD.finditer(line))
    if not found:
        return line + line
    one = rng.choice(found)
    return line[: one.end()] + rng.choice(["", " "]) + one[0] + line[one.end() :]


def _truncate(rng: random.Random, line: str) -> str:
    return line[: rng.randrange(len(line))]


def _stretch(rng: random.Random, line: str) -> str:
    """Make a line longer than controllers take."""
    size = rng.choice([100, 257, 300, 1000, 5000])
    more = rng.choice([" ", "0", "(", line, "X1 ", ";", "a", "[", "-"])
    return line + (more * (size // len(more) + 1))[:size]


CHANGES: Sequence[tuple[Callable[[random.Random, str], str], int]] = (
    (_flip, 3),
    (_drop, 3),
    (_insert, 4),
    (_odd, 1),
    (_number, 5),
    (_cut, 3),
    (_double_word, 1),
    (_truncate, 1),
    (_stretch, 1),
)


def mutated(rng: random.Random, text: str, part: float, others: Sequence[str] = ()) -> tuple[bytes, int]:
    """Damage a part of the lines of a program; return its bytes and how many lines were damaged.

    `others` are lines that may come in place of one.
    """
    lines = text.split("\n")
    found: list[str] = []
    count, n = 0, 0
    while n < len(lines):
        line = lines[n]
        n += 1
        if rng.random() >= part:
            found.append(line)
            continue
        count += 1
        kind = rng.random()
        if kind < 0.07:
            continue
        if kind < 0.13:
            found += [line] * rng.choice([2, 2, 3])
        elif kind < 0.2 and n < len(lines):
            found += [lines[n], line]
            n += 1
        elif kind < 0.24 and found:
            found.insert(rng.randrange(len(found)), line)
        elif kind < 0.3 and others:
            found.append(rng.choice(others))
        else:
            for _ in range(rng.choice([1, 1, 1, 2, 3])):
                change = rng.choices([one for one, _ in CHANGES], [weight for _, weight in CHANGES])[0]
                line = change(rng, line or " ")
            found.append(line)
    data = rng.choice(["\n", "\n", "\n", "\r\n", "\r"]).join(found) if rng.random() < 0.1 else "\n".join(found)
    raw = data.encode("latin-1", "replace") if rng.random() < 0.1 else data.encode("utf-8", "surrogatepass")
    if rng.random() < 0.1:
        at = rng.randrange(len(raw) + 1)
        odd = [bytes(rng.randrange(1, 256) for _ in range(rng.randint(1, 4)))] * 8
        raw = raw[:at] + rng.choice([*odd, *SEVERE]) + raw[at:]
    return raw, count
