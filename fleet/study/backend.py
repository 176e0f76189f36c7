"""Backend: what carries out the runs of a study, and what all backends have in common."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    from fleet.config import RunConfig
    from fleet.study.table import Row

POLL_S = 0.2
"""Longest wall time until an interrupt is noticed [s]."""
WARM_UP_S = 8.0
"""Simulated time of the run that compiles the kernels before the others begin [s]."""
N_RESTARTS = 2
"""Times in a row that what died is started again without a new row: what died for want of memory will again."""
THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")
"""One thread per process: the processes themselves use the cores."""


class Backend(Protocol):
    """Runs variants in parallel."""

    def __call__(
        self, configs: Sequence[RunConfig], jobs: int | None, interrupted: Sequence[int]
    ) -> Iterator[Row | None]:
        """Give out each row as soon as its run has ended, in whatever order, None where nothing new happened.

        Args:
            configs: The runs; their rows depend neither on the backend nor on `jobs`.
            jobs: Runs at once, >= 1; None for as many as there is room for.
            interrupted: Becomes non-empty when the user wants to stop: then the iteration ends, runs under way are
                dropped.

        Raises:
            FleetError, MapsError, PlanningError: A run was refused.
            BrokenRunError: Runs were lost again and again without a new row.
        """
        ...


def warm_up(config: RunConfig) -> RunConfig:
    """The beginning of a run: enough to compile what it needs."""
    return replace(config, duration_s=min(WARM_UP_S, config.duration_s))
