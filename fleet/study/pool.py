"""Pool: runs in processes of their own, as many at once as there are cores."""

from __future__ import annotations

import logging
import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from multiprocessing.connection import wait as wait_for
from typing import TYPE_CHECKING, TypeVar

from fleet.config import RunConfig
from fleet.errors import BrokenRunError
from fleet.study.backend import N_RESTARTS, POLL_S, THREADS, warm_up

if TYPE_CHECKING:
    from fleet.study.table import Row

_log = logging.getLogger(__name__)

Measured = TypeVar("Measured")
Measure = Callable[[RunConfig], Measured]
"""Runs to the end and says what was achieved; a function of a module, which a process can find by its name."""


def run_all(configs: Sequence[RunConfig], jobs: int | None, interrupted: Sequence[int]) -> Iterator[Row | None]:
    """Run variants in processes of this machine; see `Backend`, of which this is one, and `run_each`."""
    return run_each(configs, _measure, jobs, interrupted, again="fewer --jobs, then --resume")


def run_each(
    configs: Sequence[RunConfig],
    measure: Measure[Measured],
    jobs: int | None,
    interrupted: Sequence[int],
    *,
    again: str,
) -> Iterator[Measured | None]:
    """Run in parallel; what was measured is given out as soon as its run has ended, None where nothing new happened.

    The processes are started anew (spawned), not copied: the engines behind the planners do not survive a copy. One of
    them first compiles all kernels into the cache that the others then read. If one dies, all are started again for the
    runs that are left.

    Args:
        configs: The runs; their outcome does not depend on `jobs`.
        measure: Makes one of them.
        jobs: Processes at once, >= 1; None for one per core.
        interrupted: Becomes non-empty when the user wants to stop: then the iteration ends, runs under way are dropped.
        again: What to do when processes die, for the message.

    Raises:
        FleetError, MapsError, PlanningError: A run was refused.
        BrokenRunError: Processes died again and again without a row.
    """
    jobs = jobs or len(os.sched_getaffinity(0))
    left = dict(enumerate(configs))
    n_deaths = 0
    while left and not interrupted:
        try:
            for ended in _run_pool(left, measure, jobs, interrupted):
                if ended is None:
                    yield None
                    continue
                run, row = ended
                del left[run]
                n_deaths = 0
                yield row
        except BrokenProcessPool as error:
            if interrupted:
                return
            n_deaths += 1
            if n_deaths > N_RESTARTS:
                raise BrokenRunError(
                    f"processes died {n_deaths} times without a new row, perhaps for want of memory; valid: {again}"
                ) from error
            _log.warning("a process died; start %d of %d", n_deaths, N_RESTARTS)


def _run_pool(
    configs: Mapping[int, RunConfig], measure: Measure[Measured], jobs: int, interrupted: Sequence[int]
) -> Iterator[tuple[int, Measured] | None]:
    """One set of processes; runs are known by their keys."""
    context = multiprocessing.get_context("spawn")
    before = set(multiprocessing.active_children())
    pool = ProcessPoolExecutor(min(jobs, len(configs)), mp_context=context, initializer=begin_process)
    try:
        first = next(iter(configs.values()))
        warm: Future[Measured] = pool.submit(measure, warm_up(first))
        while not warm.done():
            yield None
            if interrupted:
                return
            wait([warm], timeout=POLL_S)
        warm.result()
        open_runs = {pool.submit(measure, config): key for key, config in configs.items()}
        while open_runs and not interrupted:
            ended, _ = wait(open_runs, timeout=POLL_S, return_when=FIRST_COMPLETED)
            for run in ended:
                yield open_runs.pop(run), run.result()
            if not ended:
                yield None
    finally:
        for process in set(multiprocessing.active_children()) - before:
            process.terminate()
        # The pool's own thread waits for the processes; one that is waited for by two threads may still be listed.
        pool.shutdown(wait=True, cancel_futures=True)


def _measure(config: RunConfig) -> Row:
    # Planners and kernels are loaded here, in the process that needs them, after `begin_process`.
    from fleet.study.measurement import measure

    return measure(config)


def begin_process() -> None:
    """Leave Ctrl-C to the process that started this one, and end with it however it ends."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    for name in THREADS:
        os.environ.setdefault(name, "1")
    threading.Thread(target=_leave_with_parent, daemon=True).start()


def _leave_with_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        wait_for([parent.sentinel])
    os._exit(1)
