"""The demo in the physical world: parcels get where they belong, nothing is touched, the same seed is the same run."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from fleet.config import ArmConfig, Grip, RunConfig
from fleet.recording import read_run
from fleet.recording.check import verify_recording
from fleet.session import Result, SessionConfig, run_session
from fleet.simulation import Simulation
from fleet.terminal.compilation import NOTICE

pytestmark = pytest.mark.bullet

HASH_AFTER = """
import sys
from fleet.config import ArmConfig, RunConfig
from fleet.simulation import Simulation
seed, workers = int(sys.argv[1]), int(sys.argv[2])
with Simulation(RunConfig(seed=seed, duration_s=12.0, arms=ArmConfig(workers_n=workers))) as simulation:
    simulation.run()
    print(simulation.state_hash(), simulation.summary().distance_empty_m)
"""
SHOWN = (
    "/world/cars/body",
    "/world/arms/link_7",
    "/world/parcels",
    "/world/paths/granted",
    "/world/paths/planned",
    "/states/cars/car_2",
    "/states/arms/arm_0",
    "/states/tasks/order_1",
    "/counts",
    "/metrics/motion",
    "/log",
)


def check(result: Result | dict, tasks: int) -> None:
    """Everything delivered, nothing touched, every parcel where the books say."""
    found = result if isinstance(result, dict) else vars(result)
    assert (found["tasks_done"], found["tasks_failed"]) == (tasks, 0)
    assert (found["robot_contacts"], found["static_contacts"]) == (0, 0)
    assert (found["parcel_balance"], found["parcels_misplaced"]) == (0, 0)
    assert found["min_clearance_m"] > 0.05
    assert found["distance_loaded_m"] > 0


def test_the_demo_command(repository: Path, tmp_path: Path) -> None:
    """What a user types, on the default site."""
    ended = subprocess.run(
        [sys.executable, "-m", "fleet.demo", "--robots", "3", "--tasks", "3", "--view", "--out", str(tmp_path)],
        cwd=repository,
        env={name: value for name, value in os.environ.items() if name not in ("DISPLAY", "WAYLAND_DISPLAY")},
        capture_output=True,
        text=True,
        check=False,
    )
    assert (ended.returncode, ended.stderr.replace(f"{NOTICE}\n", "")) == (0, "")
    result = json.loads((tmp_path / "result.json").read_text(encoding="utf-8"))
    check(result, 3)
    assert result["versions"]["pybullet"]
    report = verify_recording(tmp_path / "recording.rrd")
    assert report.verified, report.note
    assert report.missing(*SHOWN) == ()
    assert report.last_sim_s == pytest.approx(result["sim_s"], abs=0.2)
    lines = ended.stdout.splitlines()
    assert "3 cars on small, seed 0" in ended.stdout
    assert any(line.startswith("│ tasks done") and "3 of 3" in line for line in lines)
    # Plain lines off a terminal, and without a display the way to look at the file.
    assert any("s simulated" in line for line in lines)
    assert "\x1b" not in ended.stdout
    (told,) = (line for line in lines if line.startswith("no display"))
    assert str(tmp_path / "recording.rrd") in told


def test_three_cars_share_one_work_cell(tmp_path: Path) -> None:
    config = RunConfig(site="cell", robots=3, tasks=3, seed=1)
    result = run_session(config, SessionConfig(out=tmp_path, progress=False))
    check(result, 3)
    run = read_run(tmp_path)
    states = [event["state"] for event in run.events if event["kind"] == "task" and event["task"] == "order_1"]
    assert states == [
        "backlog",
        "ready",
        "assigned",
        "loading",
        "carried",
        "unloading",
        "delivered",
        "collected",
    ]
    assert (run.seed, run.config["robots"], run.config["fidelity"]) == (1, 3, "physics")
    assert run.result is not None
    assert run.result["state_hash"] == result.state_hash


def test_fingers_deliver_a_parcel() -> None:
    config = RunConfig(site="cell", robots=1, tasks=1, grip=Grip.FRICTION, arms=ArmConfig(workers_n=0))
    with Simulation(config) as simulation:
        simulation.run()
        check(vars(simulation.summary()) | {"min_clearance_m": 1.0}, 1)


def test_the_same_seed_is_the_same_run_in_any_process(repository: Path) -> None:
    """Whether arms are planned in a process of their own must not matter, another seed must."""

    def end_of(seed: int, workers: int) -> list[str]:
        ended = subprocess.run(
            [sys.executable, "-c", HASH_AFTER, str(seed), str(workers)],
            cwd=repository,
            capture_output=True,
            text=True,
            check=True,
        )
        return ended.stdout.split()

    first = end_of(0, 1)
    assert float(first[1]) > 1.0, "nothing has happened yet"
    assert end_of(0, 1) == first
    assert end_of(0, 0) == first
    assert end_of(1, 1)[0] != first[0]
