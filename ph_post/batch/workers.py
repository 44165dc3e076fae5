"""Processes that work on many jobs: of this computer, or those that a Dask scheduler has."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import math
import signal
import tempfile
import threading
import time
import warnings
from collections import deque
from collections.abc import Callable, Hashable, Iterable, Iterator, Sequence
from multiprocessing import resource_tracker
from typing import TYPE_CHECKING, Any, Final, Generic, NamedTuple, TypeVar

from ph_post.bounds import among_others
from ph_post.errors import InputError, PhPostError
from ph_post.progress import Progress, no_progress

if TYPE_CHECKING:
    from distributed import Client, Future

K = TypeVar("K", bound=Hashable)
J = TypeVar("J")
R = TypeVar("R")

PATIENCE: Final = 10.0
"""How long a scheduler may take to answer [s]."""

ALONE: Final = 300.0
"""How long this computer may be without a worker before a batch ends [s]: Dask starts none for one that dies early."""

LOOK: Final = 0.02
"""How often is looked for what is done [s]."""

AHEAD: Final = 3
"""Bundles that are handed out for each worker: one that it works on, one that it has, and one that waits for it."""

BUNDLE_JOBS: Final = 16
BUNDLE_BYTES: Final = 100_000
BUNDLE_TIME: Final = 2.0
"""Jobs and bytes that a bundle has at most, and the time after which a worker begins no further job of it [s].

Handing out and taking back costs as much for many small jobs as for one. A large job goes alone.
"""

SETTINGS: Final = {
    "logging": {"distributed": "critical"},
    "distributed.admin.tick.interval": "500ms",
    "distributed.admin.system-monitor.interval": "2s",
    "distributed.admin.large-graph-warning-threshold": "4GB",
    "distributed.scheduler.worker-saturation": 2.0,
    "distributed.scheduler.allowed-failures": 1,
    "distributed.worker.profile.enabled": False,
    "distributed.worker.memory.target": False,
    "distributed.worker.memory.spill": False,
    "distributed.worker.memory.pause": False,
    "distributed.worker.memory.terminate": 0.95,
    "distributed.comm.timeouts.connect": f"{PATIENCE:g}s",
}
"""Workers of this computer end a job that takes more memory than their share, and say nothing of their own.

What Dask measures of itself all the time would take a twentieth of a processor.
"""


class LostJobError(PhPostError):
    """No worker survived a job."""


class WorkersError(PhPostError):
    """The workers cannot go on: the scheduler has gone, or they lack this package."""


class Bundling(NamedTuple, Generic[J]):
    """How small jobs are bundled: the number of jobs, and what each adds to a bundle's size [bytes]."""

    jobs: int
    size: Callable[[J], int]


class Workers:
    """Worker processes of a Dask scheduler.

    Parameters
    ----------
    client : distributed.Client
    place : str
        What refusals call the scheduler.
    patience : float, optional
        How long there may be no worker before it is an error [s]; a queue may take its time.
    """

    def __init__(self, client: Client, place: str, patience: float = math.inf) -> None:
        self._client, self._place, self._patience = client, place, patience
        self._counted, self._count = -math.inf, 0

    @property
    def count(self) -> int:
        """How many worker processes there are, as the scheduler said less than a second ago.

        Raises
        ------
        WorkersError
            Where the scheduler has gone.
        """
        now = time.monotonic()
        if now - self._counted >= (1.0 if self._count else 0.2):
            with self._refusals():
                self._counted, self._count = now, len(self._client.ncores())
        return self._count

    def wait(self, progress: Progress) -> None:
        """Wait for the first worker: a queue may take its time."""
        while not self.count:
            progress(f"waiting for a worker of {self._place}")
            time.sleep(0.3)

    def _wait_until(self, ready: Callable[[], bool], progress: Progress) -> None:
        """Wait for what workers do, as long as there are workers."""
        seen = time.monotonic()
        while not ready():
            time.sleep(LOOK)
            if self.count:
                seen = time.monotonic()
                continue
            progress(f"waiting for a worker of {self._place}")
            if time.monotonic() - seen > self._patience:
                raise WorkersError(f"{self._place} has lost its workers; the same command goes on where it stopped")

    def on_each(self, function: Callable[..., object], *given: Any) -> None:
        """Run a function on each worker at once; of those of a computer one compiles what all of them need.

        Raises
        ------
        WorkersError
            Where a worker cannot run it.
        """
        from distributed import KilledWorker

        with self._refusals():
            addresses = sorted(self._client.ncores())
        where = {"pure": False, "allow_other_workers": True}
        asked = [self._client.submit(function, *given, workers=[address], **where) for address in addresses]
        try:
            for one in asked:
                self._result(one, no_progress)
        except KilledWorker:
            raise WorkersError(f"{self._place}: workers die of the first small program; is there memory?") from None

    def run(
        self,
        function: Callable[[J], R],
        jobs: Iterable[tuple[K, J]],
        progress: Progress = no_progress,
        bundling: Bundling[J] | None = None,
    ) -> Iterator[tuple[K, R | LostJobError]]:
        """Run a function on jobs, and yield what it gives as it comes, with the job's name.

        Jobs are made when a worker will soon be free for them: what waits takes no memory. What a worker worked on
        that dies is given to another.

        Parameters
        ----------
        function : callable
            Importable by its name, here and there.
        jobs : iterable of (name, job)
        progress : callable, optional
            Called where there is no worker.
        bundling : Bundling, optional
            How several jobs are handed out at once, by default one by one.

        Yields
        ------
        name, result
            A :class:`LostJobError` in place of the result of a job that several workers have died of.

        Raises
        ------
        WorkersError
            Where the scheduler or the workers have gone, or these lack the function.
        """
        from distributed import KilledWorker, as_completed

        waiting, suspects = _Waiting(jobs, bundling), deque[tuple[K, J]]()
        running: dict[Future[list[R]], list[tuple[K, J]]] = {}
        done = as_completed([], loop=self._client.loop)
        try:
            while waiting.more or running or suspects:
                most = AHEAD * max(self.count, 1)
                while waiting.more and len(running) < most:
                    if bundle := waiting.take(most):
                        running[self._handed_out(function, bundle, done)] = bundle
                alone = not running and bool(suspects)
                if alone:
                    bundle = [suspects.popleft()]
                    running[self._handed_out(function, bundle, done)] = bundle
                if not running:
                    continue
                self._wait_until(done.has_ready, progress)
                future = next(done)
                bundle = running.pop(future)
                try:
                    found: list[R | LostJobError] = list(self._result(future, progress))
                except KilledWorker:
                    if not alone:  # it may be another's fault that waited beside it
                        suspects.extend(bundle)
                        continue
                    found = [LostJobError("several workers died of it; one with more memory may not")]
                finally:
                    future.release()
                waiting.give_back(bundle[len(found) :])
                yield from zip((name for name, _ in bundle), found, strict=False)
        finally:
            with contextlib.suppress(Exception):
                self._client.cancel(list(running), force=True)

    def _handed_out(self, function: Callable[[J], R], bundle: list[tuple[K, J]], done: Any) -> Future[list[R]]:
        with self._refusals():
            future = self._client.submit(_work_through, function, [job for _, job in bundle], pure=False)
        done.add(future)
        return future

    def _result(self, future: Future[Any], progress: Progress) -> Any:
        """Return what a job gives. What is lost with its worker before it is here is waited for as any job is."""
        gathering = self._client.gather(future, asynchronous=True)
        asked = asyncio.run_coroutine_threadsafe(gathering, self._client.loop.asyncio_loop)
        self._wait_until(asked.done, progress)
        with self._refusals():
            return asked.result()

    @contextlib.contextmanager
    def _refusals(self) -> Iterator[None]:
        """Turn what ends the whole batch into one line; the death of workers is none of this."""
        from distributed import KilledWorker

        try:
            yield
        except (PhPostError, KilledWorker) as error:
            if isinstance(error, PhPostError):
                raise WorkersError(f"a worker of {self._place} {error}") from None
            raise
        except (ImportError, AttributeError, RuntimeError) as error:
            words = " ".join(str(error.__cause__ or error).split())
            what = f"cannot run this package: {type(error).__name__}: {words}"
            raise WorkersError(f"{self._place} {what}; expected the same ph-post everywhere") from None
        except Exception as error:
            gone = f"{self._place}: the scheduler is not there any more ({type(error).__name__})"
            raise WorkersError(f"{gone}; the same command goes on where it stopped") from None


class _Waiting(Generic[K, J]):
    """Jobs that are still to be handed out, in bundles.

    Parameters
    ----------
    jobs : iterable of (name, job)
    bundling : Bundling, optional
    """

    def __init__(self, jobs: Iterable[tuple[K, J]], bundling: Bundling[J] | None) -> None:
        self._jobs, self._bundling = iter(jobs), bundling
        self._left = 0 if bundling is None else bundling.jobs
        self._again = deque[tuple[K, J]]()
        self.more = True

    def take(self, places: int) -> list[tuple[K, J]]:
        """Return the next bundle: no more jobs than leave some for other places, so that all end at about one time."""
        most = min(BUNDLE_JOBS, max(1, self._left // (2 * places)))
        bundle: list[tuple[K, J]] = []
        room = BUNDLE_BYTES
        while len(bundle) < most and (one := self._next()) is not None:
            room -= 0 if self._bundling is None else self._bundling.size(one[1])
            if bundle and room < 0:
                self._again.appendleft(one)
                break
            bundle.append(one)
        self._left -= len(bundle)
        return bundle

    def _next(self) -> tuple[K, J] | None:
        if self._again:
            return self._again.popleft()
        one = next(self._jobs, None)
        self.more = one is not None
        return one

    def give_back(self, bundle: Sequence[tuple[K, J]]) -> None:
        """Take back what a worker had no time for; it is handed out next."""
        self._again.extendleft(reversed(bundle))
        self._left += len(bundle)
        self.more = self.more or bool(bundle)


def _work_through(function: Callable[[J], R], jobs: Sequence[J]) -> list[R]:
    """Return what a function gives of jobs, from the first to that in which the time for a bundle ends."""
    begin, found = time.monotonic(), list[R]()
    with among_others():
        for job in jobs:
            found.append(function(job))
            if time.monotonic() - begin >= BUNDLE_TIME:
                break
    return found


@contextlib.contextmanager
def open_workers(count: int, scheduler: str | None = None) -> Iterator[Workers]:
    """Start worker processes here, or take those of a scheduler that is there.

    Parameters
    ----------
    count : int
        Processes of this computer.
    scheduler : str, optional
        Address of a scheduler, in place of processes of this computer.

    Raises
    ------
    InputError
        Where no scheduler answers there, or one of another version.
    """
    if scheduler is not None:
        with _connected(scheduler) as client:
            yield Workers(client, scheduler)
        return
    import dask
    from distributed import Client, LocalCluster, system

    _silence()
    with contextlib.ExitStack() as stack:
        stack.enter_context(dask.config.set(SETTINGS))
        folder = stack.enter_context(tempfile.TemporaryDirectory(prefix="ph-post-", ignore_cleanup_errors=True))
        with _without_interrupts():
            cluster = LocalCluster(
                n_workers=count,
                threads_per_worker=1,
                processes=True,
                scheduler_kwargs={"dashboard": False, "dashboard_address": "127.0.0.1:0"},
                memory_limit=system.MEMORY_LIMIT // count,
                local_directory=folder,
                silence_logs=logging.CRITICAL,
            )
            stack.enter_context(cluster)
        client = stack.enter_context(Client(cluster, set_as_default=False))
        yield Workers(client, "this computer", ALONE)


def _silence() -> None:
    """Keep Dask from writing on standard error: what is to be known is said in one line."""
    for name in ["distributed", "asyncio", *logging.root.manager.loggerDict]:
        if name.partition(".")[0] in ("distributed", "asyncio"):
            logging.getLogger(name).setLevel(logging.CRITICAL)


@contextlib.contextmanager
def _without_interrupts() -> Iterator[None]:
    """Start threads and processes that Ctrl-C does not reach, as this process ends them; it waits for its end here.

    So does SIGTERM, which reaches them.
    """
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    resource_tracker.ensure_running()  # which lets Ctrl-C through in the thread that starts it
    with _later(signal.SIGTERM):
        before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
        try:
            yield
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)


@contextlib.contextmanager
def _later(number: int) -> Iterator[None]:
    """Put off what a signal does; a mask would do so in the processes that are started, too."""
    before = signal.getsignal(number)
    if before is None or threading.current_thread() is not threading.main_thread():
        yield
        return
    came: list[int] = []
    signal.signal(number, lambda *_: came.append(number))
    try:
        yield
    finally:
        signal.signal(number, before)
        if came:
            signal.raise_signal(number)


@contextlib.contextmanager
def _connected(address: str) -> Iterator[Client]:
    """Connect to a scheduler of the same version."""
    import dask
    import distributed
    from distributed import Client

    _silence()
    quiet = {name: SETTINGS[name] for name in SETTINGS if name.startswith(("logging", "distributed.admin"))}
    with contextlib.ExitStack() as stack:
        stack.enter_context(dask.config.set(quiet))
        stack.enter_context(warnings.catch_warnings())
        warnings.simplefilter("ignore")
        try:
            there = asyncio.run(_ask_version(address))
        except Exception as error:
            wanted = "the address that `dask scheduler` prints, as tcp://host:8786"
            # Dask tries again until the time is up, and then says so or nothing.
            silent = isinstance(error, OSError) or not str(error)
            words = f"no answer in {PATIENCE:g} s" if silent else " ".join(str(error).split())
            raise InputError(
                f"--scheduler {address}", "no Dask scheduler answers", expected=wanted, got=words
            ) from None
        if there != distributed.__version__:
            what = "the scheduler has another version of Dask"
            raise InputError(f"--scheduler {address}", what, expected=distributed.__version__, got=there)
        yield stack.enter_context(Client(address, timeout=PATIENCE, set_as_default=False))


async def _ask_version(address: str) -> str:
    """Ask a scheduler for its version of Dask; raises whatever is wrong with it."""
    from distributed.core import rpc

    async with asyncio.timeout(PATIENCE):
        there = rpc(address, timeout=PATIENCE)
        try:
            kind = (await there.identity())["type"]
            if kind != "Scheduler":
                raise ValueError(f"a {kind.lower()}")
            return str((await there.versions())["packages"]["distributed"])
        finally:
            await there.close_rpc()
