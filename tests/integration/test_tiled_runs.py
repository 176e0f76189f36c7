"""Whole runs whose physics several processes share: what stays the same, and what is left when one of them dies."""

from __future__ import annotations

import json
import os
import signal
from collections.abc import Callable
from pathlib import Path

import pytest

from fleet.config import ArmConfig, Fidelity, PhysicsConfig, RunConfig
from fleet.errors import BrokenRunError
from fleet.run.events import Event
from fleet.session import SessionConfig, run_session
from fleet.simulation import Simulation
from fleet.world.tiled.crew import WorkerCrew
from fleet.world.tiled.world import TiledWorld

pytestmark = pytest.mark.bullet


def shared(n_workers: int, duration_s: float) -> RunConfig:
    """Three cars on a small site in two tiles."""
    return RunConfig(
        site="small",
        robots=3,
        seed=1,
        fidelity=Fidelity.PHYSICS,
        duration_s=duration_s,
        arms=ArmConfig(workers_n=0),
        physics=PhysicsConfig(plain_cars_n=1, tile_cars_n=2, workers_n=n_workers),
    )


def test_parcels_cross_borders_and_the_number_of_processes_changes_nothing() -> None:
    hashes = []
    for n_workers in (1, 2):
        with Simulation(shared(n_workers, 40.0)) as simulation:
            world = simulation.world
            assert isinstance(world, TiledWorld)
            crossings, before = 0, world.tiles()
            while not simulation.finished:
                simulation.tick()
                crossings += int((world.tiles() != before).sum())
                before = world.tiles()
            hashes.append(simulation.state_hash())
            assert crossings > 0
            assert any(task.state in ("delivered", "collected", "carried") for task in simulation.board.tasks)
            contacts = world.contacts()
            assert (contacts.robot, contacts.static) == (0, 0)
            assert simulation.parcel_balance() == 0
    assert hashes[0] == hashes[1]


def test_a_run_whose_process_has_died_leaves_its_result(tmp_path: Path) -> None:
    def make(config: RunConfig, *, on_event: Callable[[Event], None]) -> Simulation:
        simulation = Simulation(config, on_event=on_event)
        assert isinstance(simulation.world, TiledWorld)
        crew = simulation.world._crew
        assert isinstance(crew, WorkerCrew)
        simulation.tick()
        os.kill(crew._workers[0]._process.pid, signal.SIGKILL)
        return simulation

    with pytest.raises(BrokenRunError, match="has ended with status -9"):
        run_session(shared(2, 5.0), SessionConfig(out=tmp_path, record=False, progress=False), make)
    result = json.loads((tmp_path / "result.json").read_text(encoding="utf-8"))
    assert "has ended with status -9" in result["broken_off"]
