"""No test runs for ever: one that hangs has failed, and the run goes on or ends."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

TESTS = Path(__file__).parents[1]

HANGING = """
import subprocess, time
from hypothesis import given, strategies

@given(strategies.integers())
def test_example(number):
    time.sleep(60)

def test_process():
    subprocess.run(["sleep", "60"])

def test_caught():
    while True:
        try:
            time.sleep(60)
        except Exception:
            pass

def test_next():
    pass
"""

DEAF = """
import signal, time

def test_deaf():
    signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGALRM])
    time.sleep(60)
"""


def run(folder: Path, text: str, seconds: float, *options: str) -> str:
    """Run a file of tests by the rules of these, with another time for each."""
    file = folder / "test_file.py"
    file.write_text(text)
    words = ["-c", str(TESTS.parent / "pyproject.toml"), "--rootdir", str(folder), "-p", "conftest", *options]
    done = subprocess.run(
        [sys.executable, "-m", "pytest", "-p", "no:cacheprovider", *words, str(file)],
        env={**os.environ, "PYTHONPATH": str(TESTS), "PH_POST_TEST_TIME": str(seconds)},
        cwd=folder,
        capture_output=True,
        text=True,
        check=False,
        timeout=120,
    )
    assert done.returncode == 1, done.stdout + done.stderr
    return done.stdout


@pytest.mark.slow
def test_a_test_that_hangs_fails_and_the_next_one_runs(tmp_path: Path) -> None:
    said = run(tmp_path, HANGING, 1.0)
    assert said.count("not done after 1 s") >= 3
    assert "3 failed, 1 passed" in said


@pytest.mark.slow
def test_a_test_that_nothing_interrupts_ends_the_run(tmp_path: Path) -> None:
    assert "crashed while running 'test_file.py::test_deaf'" in run(tmp_path, DEAF, 2.0, "-n", "1")
