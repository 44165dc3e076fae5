"""Corners that controls round or chamfer, written out, beside players of the tests that know nothing of corners."""

from __future__ import annotations

import math
import re

import numpy as np
import pytest
from scipy.spatial import cKDTree
from support.reference_player import interpret, run
from support.sinumerik_motions import Run as SiemensRun
from support.tnc_motions import TncRun

from ph_post.expand.expand import expand
from ph_post.expand.macro import FanucNumbers

HEADS = {
    "fanuc": "%\nO1\nG21 G17 G90 G94\nG0 X0. Y0. Z5.\nG1 Z-1. F200.\n",
    "siemens": "G71 G17 G90 G94\nG0 X0 Y0 Z5\nG1 Z-1 F200\n",
    "heidenhain": "BEGIN PGM A MM\nTOOL CALL 1 Z S1500\nL X+0 Y+0 Z+5 R0 FMAX\nL Z-1 F200\n",
}
ENDS = {"fanuc": "M30\n%\n", "siemens": "M30\n", "heidenhain": "END PGM A MM\n"}


def written(dialect: str, body: str) -> tuple[list[str], tuple[str, ...]]:
    """Return the lines of a body that was written out, and the notes."""
    data = (HEADS[dialect] + body + ENDS[dialect]).encode()
    found = expand(data, "a", language=FanucNumbers() if dialect == "fanuc" else dialect)
    lines = [line for line in found.data.decode().splitlines() if "ph-post" not in line.lower()]
    first = HEADS[dialect].count("\n")
    return lines[first : len(lines) - ENDS[dialect].count("\n")], found.notes


def played(dialect: str, lines: list[str]) -> np.ndarray:
    """Places in the plane of a body that moves, one by one [mm]."""
    text = HEADS[dialect] + "\n".join(lines) + "\n" + ENDS[dialect]
    if dialect == "fanuc":
        found = run(interpret(text, (0.0, 0.0, 5.0)), 0.01).motor
    else:
        found = (SiemensRun if dialect == "siemens" else TncRun)(text).path
    places = found[found[:, 2] <= -1.0 + 1e-9][:, :2]
    moved = np.append(True, np.linalg.norm(np.diff(places, axis=0), axis=1) > 5e-3)
    return places[moved]


def without_corners(lines: list[str]) -> list[str]:
    """Leave out words that the players do not know."""
    return [line for line in (re.sub(r",R\S+|RND\S*( R\S+)?", "", line).strip() for line in lines) if line]


def number(dialect: str, value: float) -> str:
    return f"{value:.3f}" if dialect == "fanuc" else f"{value:+.4f}" if dialect == "heidenhain" else f"{value:.4f}"


def contour(dialect: str, moves: list[tuple[complex, float, bool]], corners: list[str]) -> list[str]:
    """Write moves to places, lines or arcs by their radius, with the words of a corner behind each."""
    lines = []
    for place, radius, left in moves:
        x, y = (number(dialect, value) for value in (place.real, place.imag))
        if dialect == "heidenhain":
            sign = "+" if left else "-"
            lines.append(f"CR X{x} Y{y} R+{radius:.4f} DR{sign}" if radius else f"L X{x} Y{y}")
        else:
            word = ("G3" if left else "G2") if radius else "G1"
            size = "" if not radius else f" R{radius:.3f}" if dialect == "fanuc" else f" CR={radius:.4f}"
            lines.append(f"{word} X{x} Y{y}{size}")
    if dialect == "heidenhain":
        return [line for pair in zip(lines, [*corners, ""], strict=True) for line in pair if line]
    return [f"{line} {corner}".strip() for line, corner in zip(lines, [*corners, ""], strict=True)]


def corner_word(dialect: str, radius: float) -> str:
    return {"fanuc": f",R{radius:.3f}", "siemens": f"RND={radius:.4f}", "heidenhain": f"RND R{radius:.4f}"}[dialect]


def random_moves(random: np.random.Generator) -> list[tuple[complex, float, bool]]:
    found, at = [], 0j
    for _ in range(6):
        to = at + 25.0 * np.exp(1j * random.uniform(0.0, math.tau))
        radius = float(random.uniform(15.0, 60.0)) if random.random() < 0.4 else 0.0
        found.append((to, radius, bool(random.random() < 0.5)))
        at = to
    return found


@pytest.mark.parametrize("dialect", HEADS)
@pytest.mark.parametrize("seed", range(12))
def test_a_rounded_corner_is_an_arc_of_its_radius_that_goes_on_smoothly(dialect: str, seed: int) -> None:
    """The way keeps to the sharp contour, turns nowhere at once where a corner was rounded, and bends by its radius."""
    random = np.random.default_rng(seed)
    moves, radius = random_moves(random), float(random.uniform(0.5, 2.0))
    body = contour(dialect, moves, [corner_word(dialect, radius)] * 5)
    lines, notes = written(dialect, "\n".join(body) + "\n")
    kept = len([line for line in lines if re.search(r",R|RND", line)])
    assert (kept > 0) == bool(notes)
    sharp, round_ = (played(dialect, without_corners(text)) for text in (body, lines))
    assert np.allclose(round_[[0, -1]], sharp[[0, -1]], atol=2e-3)
    off = cKDTree(sharp).query(round_)[0]
    away = off > 0.02
    steps = np.diff(round_, axis=0)
    angle = np.angle(np.exp(1j * np.diff(np.unwrap(np.arctan2(steps[:, 1], steps[:, 0])))))
    assert (np.abs(angle) > 0.06).sum() <= kept
    for stretch in np.split(np.flatnonzero(away), np.flatnonzero(np.diff(np.flatnonzero(away)) > 1) + 1):
        if stretch.size > 20:
            places = round_[stretch]
            rows = np.column_stack([2.0 * places, np.ones(len(places))])
            x, y, c = np.linalg.lstsq(rows, (places**2).sum(axis=1), rcond=None)[0]
            assert math.sqrt(c + x * x + y * y) == pytest.approx(radius, rel=0.02)


@pytest.mark.parametrize(
    ("dialect", "body", "expected"),
    [
        # The example of the manual (iTNC 530, 6.4), closed to the right, with the feed of the chamfer alone.
        (
            "heidenhain",
            "L X+0 Y+30 RL F300 M3\nL X+40 IY+5\nCHF 12 F250 ; edge\nL IX+5 Y+0\nL X+0\n",
            [
                "L X+0 Y+30 RL F300 M3",
                "L X+28.0927 Y+33.5116",
                "L X+41.6971 Y+23.1206 F250 ; edge",
                "L X+45 Y+0 F300",
                "L X+0",
            ],
        ),
        (
            "heidenhain",
            "L X+20\nRND 5\nCC X+20 Y+20\nL Y+20\n",
            ["L X+15 Y+0", "CR X+20 Y+5 R+5 DR+", "CC X+20 Y+20", "L X+20 Y+20"],
        ),
        # The example of the manual (iTNC 530, 6.5) of polar lines, one of them rounded.
        (
            "heidenhain",
            "CC X+45 Y+25\nQ5 = 3\nLP PR+30 PA+0 RR F300 M3\nLP PA+60\nRND R2\nLP IPA+60\nL Z-1\nLP IPR-10 Z-2\n",
            [
                "CC X+45 Y+25",
                "Q5 = 3",
                "L X+75 Y+25 RR F300 M3",
                "L X+60.5774 Y+49.9808",
                "CR X+58.8453 Y+50.9808 R+2 DR+",
                "L X+30 Y+50.9808",
                "L Z-1",
                "L X+35 Y+42.3205 Z-2",
            ],
        ),
        ("fanuc", "X20. ,R5.\nY20. F300.\n", ["X15. Y0.", "G3 X20. Y5. R5.", "G1 X20. Y20. F300."]),
        ("fanuc", "N10 G91 X20. , C5. (a)\nN20 Y-20.\n", ["N10 G91 X15. Y0. (a)", "G1 X5. Y-5.", "N20 G1 X0. Y-15."]),
        ("siemens", "X20 CHR=5\nY20\n", ["X15 Y0", "G1 X20 Y5", "G1 X20 Y20"]),
        ("siemens", "X20 CHF=5 FRC=50 ; a\nY20\n", ["X16.464466 Y0 ; a", "G1 X20 Y3.535534 F50", "G1 X20 Y20 F200"]),
        ("siemens", "X20 RND=5\nG2 X40 Y0 I10 J0\n", ["X17.5 Y0", "", ""]),
    ],
)
def test_corners_by_hand(dialect: str, body: str, expected: list[str]) -> None:
    lines, notes = written(dialect, body)
    if expected[-1]:
        assert lines == expected
        assert not notes
    else:
        # An arc to the right that begins upright: the rounding turns to the left and touches it from outside.
        assert lines[1].startswith("G3")
        assert lines[2].startswith("G2 X40 Y0 I")


@pytest.mark.parametrize(
    ("dialect", "body", "why"),
    [
        ("heidenhain", "L X+20\nCHF 5\nL Z+5\n", "one of its moves is no cut in the plane of X and Y"),
        ("heidenhain", "L X+20\nCHF 30\nL Y+20\n", "a chamfer that is longer than its lines"),
        ("heidenhain", "L X+20 M5\nRND 3\nL Y+20\n", "an M function beside it"),
        ("heidenhain", "L X+20\nRND 3\nCYCL DEF 7.0\nL Y+20\n", "no move behind it"),
        ("heidenhain", "L X+20 Y+20 FMAX\nRND 3\nL Y+0\n", "one of its moves is no cut in the plane of X and Y"),
        ("heidenhain", "L X+20\nRND 3\nLP PR+5 PA+0\n", "no move behind it"),
        ("fanuc", "X20. ,R5.\nG0 Y20.\n", "one of its moves is no cut in the plane of X and Y"),
        ("fanuc", "X20. ,R30.\nY20.\n", "a rounding that does not fit between its moves"),
        ("fanuc", "X20. ,R3.\nX40.\n", "two moves that make no corner"),
        ("fanuc", "X20. ,R3.\nG68 X0. Y0. R10.\nY40.\n", "no move behind it"),
        ("siemens", "X20 RND=3\nY20 F500\n", "the feed changes behind it, and a setting says which one it has"),
        ("siemens", "X20 RND=3\nG2 X40 Y0 CR=-20\n", "one of its moves is no cut in the plane of X and Y"),
    ],
)
def test_what_is_not_certain_stays_and_is_named(dialect: str, body: str, why: str) -> None:
    lines, notes = written(dialect, body)
    assert lines == body.splitlines() or "G68" in body
    assert len(notes) == 1 + ("G68" in body)
    assert why in notes[-1]


def test_a_corner_of_a_size_that_is_not_known_is_named_with_its_line() -> None:
    """Whether 15 is 15 mm or 15 µm is a setting of the control."""
    data = (HEADS["fanuc"] + "G1 X20. ,R 15\nY20.\n" + ENDS["fanuc"]).encode()
    (note,) = expand(data, "a", language=FanucNumbers(doubtful=True)).notes
    line = HEADS["fanuc"].count("\n") + 1
    assert (
        note == f"a:{line}: ,R15 stays as it is: a length without a decimal point, which the control's setting decides"
    )


@pytest.mark.parametrize(
    ("dialect", "scale", "body"),
    [
        ("fanuc", "G51 X0. Y0. Z0. I2. J2. K2.", "G1 X20. Y1. Z-1.\nX30. ,R3.\nY20.\n"),
        ("fanuc", "G51 X0. Y0. P2000", "G1 X20. Y1. Z-1.\nX30. ,R3.\nY20.\n"),
        ("siemens", "SCALE X2 Y2", "G1 X20 Y1 Z-1\nX30 RND=3\nY20\n"),
        ("heidenhain", "CYCL DEF 11.1 SCL 2", "L X+20 Y+1 Z-1\nL X+30\nRND 3\nL Y+20\n"),
    ],
)
def test_a_corner_in_scaled_coordinates_stays(dialect: str, scale: str, body: str) -> None:
    lines, notes = written(dialect, f"{scale}\n{body}")
    assert lines == [scale, *body.splitlines()]
    assert any("scaled" in note for note in notes)


@pytest.mark.parametrize("arc", ["G2 X40. Y0. I0. J0.", "G2 X40. Y0. I12. J0."])
def test_a_corner_at_an_arc_that_is_none_stays(arc: str) -> None:
    lines, notes = written("fanuc", f"X20. ,R3.\n{arc}\n")
    assert lines == ["X20. ,R3.", arc]
    assert notes[0].endswith("an arc whose ends are not on one circle")


def test_a_tangential_arc_by_hand() -> None:
    """The example of the manual (iTNC 530, 6.4); its radius by the chord and the angle between chord and direction."""
    lines, notes = written("heidenhain", "L X+0 Y+25 RL F300 M3\nL X+25 Y+30\nCT X+45 Y+20 F200 ; on\nL Y+0\n")
    chord, between = math.hypot(20.0, 10.0), math.atan2(1.0, 5.0) + math.atan2(1.0, 2.0)
    radius = chord / (2.0 * math.sin(between))
    assert lines[2] == f"CR X+45 Y+20 R+{radius:.4f} DR- F200 ; on"
    assert not notes


@pytest.mark.parametrize("seed", range(20))
def test_tangential_arcs_go_on_smoothly(seed: int) -> None:
    random = np.random.default_rng(seed)
    body, at, direction = ["L X+20.0000 Y+0.0000"], 20.0 + 0.0j, 1.0 + 0.0j
    for _ in range(3):
        turn = float(random.choice([-1.0, 1.0])) * math.radians(float(random.uniform(3.0, 80.0)))
        way = direction * np.exp(1j * turn) * float(random.uniform(10.0, 30.0))
        at, direction = at + way, direction * np.exp(2j * turn)
        body.append(f"CT X{at.real:+.4f} Y{at.imag:+.4f}")
    lines, notes = written("heidenhain", "\n".join(body) + "\n")
    assert [line[:2] for line in lines] == ["L ", "CR", "CR", "CR"]
    assert not notes
    places = played("heidenhain", lines)
    steps = np.diff(places, axis=0)
    turned = np.diff(np.unwrap(np.arctan2(steps[:, 1], steps[:, 0])))
    assert np.abs(turned).max() < 0.01
    assert np.allclose(places[-1], [at.real, at.imag], atol=1e-3)


@pytest.mark.parametrize(
    "body",
    [
        "L X+20\nRND 3\nCT X+30 Y+10\n",
        "L X+20\nCT X+20 Y+10\n",
        "L X+20\nCT X+40 Y+0\n",
        "L X+20\nCYCL DEF 7.0\nCT X+30 Y+10\n",
        "L X+20\nCT X+30 Y+10 Z-2\n",
    ],
)
def test_a_tangential_arc_that_is_not_certain_stays(body: str) -> None:
    """Behind a corner, of a half turn, straight on, from nowhere, and as a helix."""
    assert written("heidenhain", body)[0] == body.splitlines()


@pytest.mark.parametrize(
    ("line", "end", "written_out"),
    [
        ("SOFT", "", True),
        ('MSG("G91 G18")', "", True),
        ("M6 T1", "", True),
        ("G91 SOFT", "G90", False),
        ("/G91", "G90", False),
        ("/G90", "G90", True),
        ("G18 SOFT", "G17", False),
        ("/G18", "G17", False),
        ("SIDE_2", "G90 G17", False),
        ("L20", "G90 G17", False),
        ("MCALL CYCLE81(10,0,2,-5)", "MCALL", False),
        ("/MCALL L20", "MCALL\nG90 G17", False),
        ("MCALL L20\nX1\nMCALL", "G90 G17", False),
        ("RNDM=2", "RNDM=0", False),
        ("FRCM=100", "FRCM=0", False),
        ("/FRCM=100", "FRCM=0.", False),
    ],
)
def test_a_corner_behind_what_is_not_followed_is_written_out_where_all_is_known(
    line: str, end: str, written_out: bool
) -> None:
    """A line that is not read may leave another measure, plane or feed, or something behind each block."""
    corner = "G1 X20 Y1 F200\nX30 Y1 RND=3\nX30 Y20"
    lines, _ = written("siemens", f"{line}\n{corner}\nG1 X0 Y0\n")
    lines = lines[line.count("\n") :]
    assert (lines[2:4] != corner.splitlines()[1:]) == written_out
    lines, _ = written("siemens", f"{line}\n{end}\n{corner}\nG1 X0 Y0\n")
    assert any(one.startswith("G3 X30 Y4 CR=3") for one in lines)


@pytest.mark.parametrize("ended", ["/MCALL", "/RNDM=0", "/FRCM=0", "/G90"])
def test_a_line_with_a_slash_ends_nothing_that_keeps_corners(ended: str) -> None:
    begun = {"/MCALL": "MCALL L20", "/RNDM=0": "RNDM=2", "/FRCM=0": "FRCM=50", "/G90": "G91 SOFT"}[ended]
    body = f"{begun}\n{ended}\nG17\nG1 X20 Y1 F200\nX30 Y1 RND=3\nX30 Y20\n"
    assert written("siemens", body)[0] == body.splitlines()


def test_a_corner_with_a_feed_of_its_own_is_written_out_whatever_frcm_says() -> None:
    lines, _ = written("siemens", "FRCM=100\nG1 X20 Y1 F200\nX30 Y1 RND=3 FRC=50\nX30 Y20\n")
    assert lines[2:] == ["X27 Y1", "G3 X30 Y4 CR=3 F50", "G1 X30 Y20 F200"]
