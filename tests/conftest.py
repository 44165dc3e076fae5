"""What all tests share: the helpers in tests/support, their order, and the renewal of golden files."""

from __future__ import annotations

import faulthandler
import gc
import os
import signal
import sys
from collections import Counter
from collections.abc import Generator
from pathlib import Path
from typing import Any, NoReturn

# Tests run side by side, a process a core: more threads in each would only wait for each other. Before numpy.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import hypothesis
import pytest

sys.path.insert(0, str(Path(__file__).parent))

from support.amount import ALL, EVERY, examples, is_drawn

# More than a hundred processes start in a run: what one of them has compiled is kept for the next.
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
sys.dont_write_bytecode = False

# No test fails on a time, unless it hangs: how long one takes depends on who else uses the machine. A commit gives
# the same answer wherever it is tested: the examples are drawn from the test itself, and anew only where that is
# asked for.
hypothesis.settings.register_profile(
    "ph_post", deadline=None, max_examples=examples(100), derandomize="PH_POST_NEW_EXAMPLES" not in os.environ
)
hypothesis.settings.load_profile("ph_post")

HERE = Path(__file__).parent

SLOW_FOLDERS = ("tests/pages/", "tests/hidden/")
"""Folders whose tests drive a browser, or hide effects in plants and look for them."""

ONE_AT_A_TIME = "tests/controllers"

LONGEST = float(os.environ.get("PH_POST_TEST_TIME", "600"))
"""Time [s] after which a test hangs: the slowest takes a tenth of it, and waits of their own end sooner."""

LONG = (
    "controllers/test_rehearsals.py",
    "controllers/test_hal_servos.py",
    "controllers/test_rehearse_command.py",
    "controllers/test_axis_filter.py",
    "controllers/test_corners.py",
    "controllers/test_real_cuts.py",
    "controllers/test_crossings.py",
    "controllers/test_linuxcnc.py",
    "controllers/test_model.py",
    "controllers/test_calibration_programs.py",
    "controllers/test_reader_linuxcnc.py",
    "controllers/test_freecad.py",
    "hidden/test_named.py",
    "hidden/test_emps.py",
    "hidden/test_closed_loops.py",
    "compensate/test_friction.py",
    "paper/test_strategies_win.py",
    "identify/test_cascade.py",
    "batch/test_workers.py",
    "corpus/test_corpus.py",
    "docs/test_snippets.py",
    "property/test_fuzz.py",
    "identify/test_identify.py",
    "compensate/test_race.py",
    "diagnose/test_cascades.py",
    "hidden/test_cascade_loop.py",
    "cli/test_compare.py",
    "cli/test_main.py",
    "hidden/test_loop.py",
    "pages/test_motion_page.py",
    "cli/test_examples.py",
    "compensate/test_at_rest.py",
    "api/test_compensation.py",
    "api/test_compiling.py",
    "diagnose/test_sides.py",
    "cli/test_pipelines.py",
    "property/test_auto_races.py",
    "api/test_short_time.py",
    "hidden/test_draw.py",
    "edit/test_diameters.py",
    "drive/test_sweep.py",
    "verify/test_crossings.py",
    "dialects/test_siemens_exact.py",
    "cli/test_result_line.py",
    "samples/test_samples.py",
    "api/test_programs.py",
    "cli/test_simulate.py",
    "hidden/test_ranks.py",
    "edit/test_restarts.py",
    "api/test_crossed_paths.py",
    "dialects/test_languages.py",
    "cli/test_report.py",
    "compensate/test_lead.py",
    "pages/test_other_pages.py",
    "simulate/test_slow.py",
    "edit/test_cutter_contours.py",
    "diagnose/test_recorders.py",
    "api/test_led_programs.py",
    "support/test_reference_machine.py",
    "edit/test_crossings.py",
    "identify/test_hand_measurements.py",
    "identify/test_log_quality.py",
    "slicers/test_real_slicers.py",
)
"""Files that take longest, in the order they begin in: at the end no process is left alone with one."""

BEGINNING = {HERE / name: number for number, name in enumerate(LONG)}


@pytest.hookimpl(wrapper=True)
def pytest_collection(session: pytest.Session) -> Generator[None, object, object]:
    """Keep the thousands of tests, which live to the end, out of what is searched for garbage while they run."""
    gc.disable()
    found = yield
    gc.freeze()
    gc.enable()
    return found


@pytest.hookimpl(wrapper=True)
def pytest_make_collect_report(collector: pytest.Collector) -> Generator[None, pytest.CollectReport, object]:
    """Have each process begin with other files: what one has compiled of a fresh clone, the others read."""
    report = yield
    worker = getattr(collector.config, "workerinput", None)
    if worker is not None and isinstance(collector, pytest.Directory) and report.result:
        first = len(report.result) * int(worker["workerid"].removeprefix("gw")) // worker["workercount"]
        report.result = [*report.result[first:], *report.result[:first]]
    return report


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Leave the slow tests out where nobody asks for them, or for a file by its name; long files first."""
    items.sort(key=lambda item: item.path)  # whichever a process began with
    named = any(Path(word.partition("::")[0]).suffix == ".py" for word in config.args)
    cases: Counter[str] = Counter()
    for item in items:
        if thinned := item.get_closest_marker("thinned"):
            function = item.nodeid.partition("[")[0]
            (always,) = thinned.args
            assert always % 2 == 0, f"{function}: what is tried always is tried by .ci/run too"
            if cases[function] % always:
                item.add_marker(pytest.mark.slow)
            if cases[function] % (always // 2) and os.environ.get(ALL) != EVERY:
                item.add_marker(pytest.mark.skip(reason=f"one in {always // 2} is tried: all with {ALL}={EVERY}"))
            cases[function] += 1
        if item.nodeid.startswith(SLOW_FOLDERS):
            item.add_marker(pytest.mark.slow)
        if item.get_closest_marker("slow") and not (named or os.environ.get(ALL)):
            item.add_marker(pytest.mark.skip(reason=f"slow: runs with {ALL}=1, or where its file is named"))
        drawn = item.get_closest_marker("drawn")
        if drawn and item.get_closest_marker("slow") and not (thinned or named or os.environ.get(ALL) == EVERY):
            (of,) = drawn.args
            if not is_drawn(item.nodeid, of):
                item.add_marker(pytest.mark.skip(reason=f"one in {of} is drawn: all with {ALL}={EVERY}"))
    if not named:
        items.sort(key=lambda item: BEGINNING.get(item.path, len(LONG)))


class TestTimeError(BaseException):
    """A test that hangs. It is no Exception: neither the package nor hypothesis catches it, to try once more."""


@pytest.hookimpl(wrapper=True)
def pytest_runtest_protocol(item: pytest.Item) -> Generator[None, object, object]:
    """Fail a test that hangs, and go on; where nothing interrupts it, as in compiled code, end process and run."""

    def fail(*_: object) -> NoReturn:
        raise TestTimeError(f"not done after {LONGEST:g} s")

    signal.signal(signal.SIGALRM, fail)
    signal.setitimer(signal.ITIMER_REAL, LONGEST)
    faulthandler.dump_traceback_later(2.0 * LONGEST, exit=True, file=sys.__stderr__)
    try:
        return (yield)
    finally:
        faulthandler.cancel_dump_traceback_later()
        signal.setitimer(signal.ITIMER_REAL, 0.0)


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_auto_num_workers(config: pytest.Config) -> int:
    """One process a core, and one that waits for LinuxCNC most of the time."""
    return len(os.sched_getaffinity(0)) + 1


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: Any) -> Any:
    """Keep the tests of `controllers` in one process, as a computer runs one LinuxCNC at a time."""
    if config.getoption("dist") != "loadfile":
        return None
    from xdist.scheduler import LoadFileScheduling

    class ByFile(LoadFileScheduling):
        def _split_scope(self, nodeid: str) -> str:
            return ONE_AT_A_TIME if nodeid.startswith(f"{ONE_AT_A_TIME}/") else super()._split_scope(nodeid)

    return ByFile(config, log)


def pytest_addoption(parser: pytest.Parser) -> None:
    """`--renew-golden` writes the programs of tests/golden anew instead of comparing them."""
    parser.addoption(
        "--renew-golden",
        action="store_true",
        help="write the expected files in tests/golden anew; read the difference before committing it",
    )
