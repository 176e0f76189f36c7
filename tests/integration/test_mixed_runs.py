"""Whole runs in the mixed world: tasks are done, nothing touches, and they can be repeated, watched and explained."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from fleet.config import ArmConfig, Fidelity, Grip, Perception, RunConfig
from fleet.replay.again import load_recorded, repeat
from fleet.session import SessionConfig, run_session
from fleet.simulation import Simulation

pytestmark = pytest.mark.bullet

CONFIG = RunConfig(
    site="small",
    robots=3,
    tasks=5,
    seed=2,
    fidelity=Fidelity.MIXED,
    duration_s=240.0,
    arms=ArmConfig(workers_n=0),
)


def check(simulation: Simulation) -> None:
    """All is done, without a touch, and every parcel is where it is booked."""
    summary = simulation.summary()
    assert summary.tasks_done == summary.tasks_total
    assert (summary.robot_contacts, summary.static_contacts) == (0, 0)
    assert (summary.parcel_balance, summary.parcels_misplaced, summary.parcels_dropped) == (0, 0, 0)
    assert summary.slip_max_m is not None
    assert summary.slip_max_m < 0.005


def test_tasks_are_done_and_the_same_seed_gives_the_same_run() -> None:
    hashes = []
    for _ in range(2):
        with Simulation(CONFIG) as simulation:
            awake = 0
            while not simulation.finished:
                simulation.tick()
                awake += simulation.world.n_awake()  # type: ignore[attr-defined]
            check(simulation)
            # Most of the time most stations rest.
            assert 0 < awake < 0.6 * simulation.now * len(simulation.stations)
            hashes.append(simulation.state_hash())
    assert hashes[0] == hashes[1]


@pytest.mark.parametrize(
    "changes",
    [{"grip": Grip.FRICTION}, {"perception": Perception.CAMERA, "askew": True}, {"site": "twin"}],
    ids=["friction", "camera", "two arms over one dock"],
)
def test_fingers_cameras_and_shared_docks(changes: dict[str, object]) -> None:
    config = replace(CONFIG, **{"site": "cell", "robots": 2, "tasks": 3, **changes})  # type: ignore[arg-type]
    with Simulation(config) as simulation:
        simulation.run()
        check(simulation)


def test_a_run_is_checked_recorded_and_played_again(tmp_path: Path) -> None:
    config = replace(CONFIG, site="cell", robots=1, tasks=2)
    result = run_session(config, SessionConfig(out=tmp_path / "run", check=True, lidar=True))
    assert (result.tasks_done, result.fidelity) == (2, "mixed")
    assert (tmp_path / "run" / "recording.rrd").stat().st_size > 0
    again = repeat(load_recorded(tmp_path / "run"), SessionConfig(out=tmp_path / "again", record=False))
    assert again.result.state_hash == result.state_hash
