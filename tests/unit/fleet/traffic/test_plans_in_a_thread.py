"""Plans that are made in a thread while the run goes on."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any

import pytest

from fleet.config import ArmConfig, Fidelity, RunConfig
from fleet.simulation import Simulation
from fleet.traffic import replanning


class Counted(ThreadPoolExecutor):
    """Counts what it was given."""

    n_given = 0

    def submit(self, work: Callable[..., Any], /, *words: Any, **settings: Any) -> Future[Any]:
        """As an executor does."""
        Counted.n_given += 1
        return super().submit(work, *words, **settings)


def test_plans_made_in_a_thread_change_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    """Also with faults, which throw plans away while they are made."""
    hashes, threads = [], []
    for least in (replanning.THREAD_CARS, 1):
        monkeypatch.setattr(replanning, "THREAD_CARS", least)
        monkeypatch.setattr(replanning, "ThreadPoolExecutor", Counted)
        config = RunConfig(
            site="medium",
            robots=12,
            seed=2,
            fidelity=Fidelity.KINEMATIC,
            duration_s=45.0,
            chaos_per_h=600.0,
            arms=ArmConfig(workers_n=0),
        )
        with Simulation(config) as simulation:
            while not simulation.finished:
                simulation.tick()
            hashes.append(simulation.state_hash())
            thread = simulation.traffic._thread
        assert thread is None or thread._shutdown, "the thread ends with the run"
        threads.append(Counted.n_given)
    assert hashes[0] == hashes[1]
    assert threads[0] == 0 < threads[1]
