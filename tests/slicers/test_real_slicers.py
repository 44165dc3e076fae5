"""Real slicers slice a small model, and what they write goes through our command as they call it.

PrusaSlicer calls it itself, as its script for post-processing; Cura's engine knows no scripts, so the test calls it on
what the engine wrote, as Cura's script does. Debian has prusa-slicer, cura-engine, and its definitions in cura.
"""

from __future__ import annotations

import math
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from support.corpus_judge import Judged, compare

ROOT = Path(__file__).parents[2]
DEFINITIONS = Path(os.environ.get("CURA_RESOURCES", "/usr/share/cura/resources"), "definitions")
PRUSA, CURA = shutil.which("prusa-slicer"), shutil.which("CuraEngine")

pytestmark = pytest.mark.slow


def ellipse(folder: Path, count: int = 64, height: float = 0.6) -> Path:
    """Write a low elliptic cylinder [mm]."""
    rim = [(20.0 * math.cos(math.tau * k / count), 14.0 * math.sin(math.tau * k / count)) for k in range(count)]
    facets = []
    for (ax, ay), (bx, by) in zip(rim, [*rim[1:], rim[0]], strict=True):
        facets += [
            ((ax, ay, 0.0), (bx, by, 0.0), (bx, by, height)),
            ((ax, ay, 0.0), (bx, by, height), (ax, ay, height)),
            ((0.0, 0.0, 0.0), (bx, by, 0.0), (ax, ay, 0.0)),
            ((0.0, 0.0, height), (ax, ay, height), (bx, by, height)),
        ]
    lines = ["solid model"]
    for facet in facets:
        corners = (f"vertex {x:.4f} {y:.4f} {z:.4f}" for x, y, z in facet)
        lines += ["facet normal 0 0 0", "outer loop", *corners, "endloop", "endfacet"]
    file = folder / "model.stl"
    file.write_text("\n".join([*lines, "endsolid model", ""]))
    return file


def printer(folder: Path) -> Path:
    """Write the machine file of a printer."""
    text = (ROOT / "samples" / "machines" / "stepper.toml").read_text()
    text = re.sub(r"lost_motion_mm = [\d.]+", "lost_motion_mm = 0.05", text)
    file = folder / "printer.toml"
    file.write_text(text.replace('dialect = "grbl"', 'dialect = "marlin"'))
    return file


def script(folder: Path) -> Path:
    """Write what a slicer calls with the name of its program."""
    file = folder / "post.sh"
    words = f'{sys.executable} -m ph_post slicer -m "{printer(folder)}" --backup "$@"'
    file.write_text(f'#!/bin/sh\nPYTHONPATH="{ROOT}" exec {words}\n')
    file.chmod(0o755)
    return file


def prusa(folder: Path) -> Path:
    """Slice with PrusaSlicer, which calls the script."""
    if PRUSA is None:
        pytest.skip("PrusaSlicer is not installed: it comes with Debian's prusa-slicer")
    out = folder / "out.gcode"
    call = [PRUSA, "--export-gcode", "--post-process", str(script(folder)), "-o", str(out), str(ellipse(folder))]
    subprocess.run(call, check=True, capture_output=True, timeout=300)
    return out


def cura(folder: Path) -> Path:
    """Slice with Cura's engine, and call the script on what it wrote."""
    if CURA is None or not (DEFINITIONS / "fdmprinter.def.json").exists():
        pytest.skip("CuraEngine or its definitions are not installed: they come with Debian's cura-engine and cura")
    out, model = folder / "out.gcode", ellipse(folder)
    files = [str(DEFINITIONS / f"{name}.def.json") for name in ("fdmprinter", "fdmextruder")]
    call = [CURA, "slice", "-j", files[0], "-e0", "-j", files[1], "-l", str(model), "-o", str(out)]
    settings = ["-s", "mesh_position_z=0", "-s", "layer_height=0.2", "-s", "infill_line_distance=4"]
    subprocess.run([*call, *settings], check=True, capture_output=True, timeout=300)
    subprocess.run([str(script(folder)), str(out)], check=True, capture_output=True, timeout=300)
    return out


def filament(text: str) -> list[float]:
    """Return how much filament goes in and out [mm], between the places where its count is set."""
    found, at, relative = [0.0], 0.0, False
    for line in text.splitlines():
        code = line.partition(";")[0]
        relative = (relative or "M83" in code) and "M82" not in code
        word = re.search(r"\bE(-?\d*\.?\d+)", code)
        if word is None:
            continue
        if "G92" in code:
            found.append(0.0)
        else:
            found[-1] += float(word[1]) - (0.0 if relative else at)
        at = float(word[1])
    return found


@pytest.mark.parametrize("slicer", [prusa, cura], ids=["prusa", "cura"])
def test_a_slicers_program_comes_out_compensated(tmp_path, slicer):
    out = slicer(tmp_path)
    before = Path(f"{out}.bak").read_bytes()
    after = out.read_bytes()
    judged = compare(Judged("compensated"), "marlin", before, after)
    assert judged.p95 is not None
    assert judged.p95[1] < 0.2 * judged.p95[0]
    one, other = filament(before.decode()), filament(after.decode())
    assert other == pytest.approx(one, abs=1e-3)
    orders = [re.findall(r"(?m)^(?:M10[4-9]|M1[49]0|M8[24]|T\d).*$", text.decode()) for text in (before, after)]
    assert orders[0] == orders[1]
    back = subprocess.run(
        [sys.executable, "-m", "ph_post", "convert", "--undo", str(out), "-o", "-"],
        check=True,
        capture_output=True,
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
    )
    assert back.stdout == before
