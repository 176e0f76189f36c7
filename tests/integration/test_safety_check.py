"""Runs that are checked after every tick: today's fleet passes, and one that is broken stops with its evidence."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from fleet.arrays import FloatArray
from fleet.cli.main import main
from fleet.config import EVENT_KINDS, ArmConfig, Fidelity, RunConfig, ScenarioEvent
from fleet.insight.metrics import Summary
from fleet.recording import read_run
from fleet.safety.check import SafetyCheck
from fleet.simulation import Simulation
from fleet.traffic.executor import Executor
from fleet.world.kinematic import KinematicWorld

SITES = ("cell", "dense", "dense_large", "medium", "small", "twin", "two_way")


def checked(config: RunConfig) -> Summary:
    """Run to the end, checked; returns what came of it."""
    with Simulation(config) as simulation:
        check = SafetyCheck(simulation.view)
        simulation.run(lambda _: check.tick())
        return simulation.summary()


def test_every_site_is_listed(repository: Path) -> None:
    assert sorted(path.stem for path in (repository / "maps/data").glob("*.toml")) == sorted(SITES)


@pytest.mark.parametrize("fidelity", [Fidelity.GRID, Fidelity.KINEMATIC])
@pytest.mark.parametrize("site", SITES)
def test_every_site_is_safe(site: str, fidelity: Fidelity) -> None:
    robots = 2 if site == "cell" else 6
    summary = checked(
        RunConfig(site=site, robots=robots, fidelity=fidelity, duration_s=30.0, seed=5, arms=ArmConfig(workers_n=0))
    )
    assert summary.distance_empty_m > 5.0, "they drive"


@pytest.mark.bullet
def test_physics_is_safe() -> None:
    summary = checked(
        RunConfig(site="small", robots=4, fidelity=Fidelity.PHYSICS, duration_s=15.0, arms=ArmConfig(workers_n=0))
    )
    assert summary.distance_empty_m > 5.0


def test_what_goes_wrong_on_purpose_is_no_violation() -> None:
    """A push, a death, a lost grip, a slow arm and a blocked lane, with all cars under way."""
    events = (
        ScenarioEvent(time_s=6.0, kind="car_pushed", target="car_1", parameters={"dx_m": 0.1, "dy_m": 0.4}),
        ScenarioEvent(time_s=8.0, kind="grip_lost", target="arm_0", parameters={}),
        ScenarioEvent(time_s=10.0, kind="arm_slow", target="arm_1", parameters={"factor": 0.3}),
        ScenarioEvent(time_s=12.0, kind="car_dead", target="car_2", parameters={}),
        ScenarioEvent(time_s=20.0, kind="lane_blocked", target="1,8", parameters={"duration_s": 10.0}),
    )
    config = RunConfig(
        site="small", robots=8, fidelity=Fidelity.KINEMATIC, duration_s=90.0, events=events, arms=ArmConfig(workers_n=0)
    )
    assert checked(config).sim_s == 90.0


@pytest.mark.parametrize("kind", [name for name, kind in EVENT_KINDS.items() if kind.moves_cars])
def test_cars_that_are_moved_are_excused(kind: str) -> None:
    """All at once, two by two among others that drive."""
    moved = {"dx_m": 0.3, "dy_m": 0.5} if "dx_m" in EVENT_KINDS[kind].parameters else {"delay_s": 0.3}
    events = tuple(
        ScenarioEvent(time_s=time_s, kind=kind, target=f"car_{car}", parameters=moved)
        for time_s, cars in ((6.0, (0, 1)), (14.0, (2, 3)), (30.0, (0, 5)))
        for car in cars
    )
    config = RunConfig(
        site="small", robots=8, fidelity=Fidelity.KINEMATIC, duration_s=90.0, events=events, arms=ArmConfig(workers_n=0)
    )
    assert checked(config).sim_s == 90.0


def test_a_check_changes_nothing() -> None:
    config = RunConfig(
        site="small", robots=4, fidelity=Fidelity.KINEMATIC, duration_s=30.0, arms=ArmConfig(workers_n=0)
    )
    with Simulation(config) as alone:
        alone.run()
        assert checked(config).state_hash == alone.state_hash()


def demo(out: Path, *words: str) -> int | str | None:
    """Exit status of the demo command."""
    usual = ["--fidelity", "kinematic", "--robots", "2", "--duration", "4", "--no-record", "--out", str(out)]
    with pytest.raises(SystemExit) as stop:
        main(["demo", *usual, "--check", *words])
    return stop.value.code


def test_a_safe_run_ends_as_ever(tmp_path: Path) -> None:
    assert demo(tmp_path) == 0
    assert not (tmp_path / "violation.json").exists()


def test_a_violation_stops_the_run_and_leaves_its_evidence(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    tick = Executor.tick

    def without_grants(self: Executor, world: KinematicWorld) -> FloatArray:
        commands = tick(self, world)
        commands[1] = (0.0, 1.0)  # car_1 drives straight on, whatever it was granted
        return commands

    monkeypatch.setattr(Executor, "tick", without_grants)
    assert demo(tmp_path) == 1
    said = capsys.readouterr().err.strip().splitlines()[-1]
    evidence = json.loads((tmp_path / "violation.json").read_text(encoding="utf-8"))
    assert said == f"python -m fleet: {evidence['message']}"
    assert "invariant footprint: car_1 at x" in said
    assert "valid: its own cells" in said
    run = read_run(tmp_path)
    assert evidence["run"] == run.name
    assert (evidence["invariant"], evidence["robots"][0]) == ("footprint", "car_1")
    assert len(evidence["values"]["pose"]) == 3
    (event,) = (event for event in run.events if event["kind"] == "violation")
    assert (event["tick"], event["message"]) == (evidence["tick"], evidence["message"])
    assert run.result is not None
    assert run.result["broken_off"] == evidence["message"]
    monkeypatch.undo()
    assert demo(tmp_path) == 0
    assert not (tmp_path / "violation.json").exists(), "that of the earlier run"
