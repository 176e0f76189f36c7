"""Work in a thread: it begins at once, and its result or its error comes when it is asked for."""

from __future__ import annotations

import threading

import pytest

from fleet.config import ArmConfig, Fidelity, RunConfig
from fleet.simulation import Simulation
from fleet.traffic import replanning
from fleet.traffic.thread_work import ThreadWork


def test_work_goes_on_beside_what_asked_for_it() -> None:
    begun, go_on = threading.Event(), threading.Event()

    def work() -> int:
        begun.set()
        go_on.wait(10.0)
        return 7

    under_way = ThreadWork(work)
    assert begun.wait(10.0)
    go_on.set()
    assert [under_way.result(), under_way.result()] == [7, 7]


def test_what_goes_wrong_is_told_to_whoever_asks() -> None:
    def work() -> int:
        raise ValueError("no plan")

    with pytest.raises(ValueError, match="no plan"):
        ThreadWork(work).result()


def test_plans_made_in_a_thread_change_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    """Also with faults, which throw plans away while they are made."""
    hashes, threads = [], []
    for least in (replanning.THREAD_CARS, 1):
        monkeypatch.setattr(replanning, "THREAD_CARS", least)
        made = []
        monkeypatch.setattr(replanning, "ThreadWork", lambda work, made=made: made.append(1) or ThreadWork(work))
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
        threads.append(len(made))
    assert hashes[0] == hashes[1]
    assert threads[0] == 0 < threads[1]
