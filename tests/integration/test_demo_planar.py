"""The demo on the fast worlds: the same missions without physics, on larger sites, from files, and again and again."""

import json
import random
from pathlib import Path

import pytest

from fleet.cli.main import main
from fleet.config import WHOLE, ArmConfig, Fidelity, RunConfig
from fleet.errors import FleetError
from fleet.insight.metrics import Summary
from fleet.recording.check import verify_recording
from fleet.simulation import Simulation

PLANAR = [Fidelity.KINEMATIC, Fidelity.GRID]


def simulated(**settings: object) -> Summary:
    """Run to the end in this process."""
    with Simulation(RunConfig(arms=ArmConfig(workers_n=0), **settings)) as simulation:  # type: ignore[arg-type]
        simulation.run()
        return simulation.summary()


def check(summary: Summary) -> None:
    """Everything delivered, nothing touched, every parcel where the books say."""
    assert (summary.tasks_done, summary.tasks_failed) == (summary.tasks_total, 0)
    assert (summary.robot_contacts, summary.static_contacts) == (0, 0)
    assert (summary.parcel_balance, summary.parcels_misplaced) == (0, 0)


def demo(words: list[str], status: int = 0) -> None:
    with pytest.raises(SystemExit) as stop:
        main(["demo", *words])
    assert stop.value.code == status


@pytest.mark.parametrize("fidelity", PLANAR)
@pytest.mark.parametrize(("site", "robots"), [("cell", 1), ("cell", 3), ("small", 1), ("small", 3), ("small", 8)])
def test_all_is_delivered(fidelity: Fidelity, site: str, robots: int) -> None:
    check(simulated(fidelity=fidelity, site=site, robots=robots, seed=robots))


@pytest.mark.parametrize("seed", range(1, 6))
def test_all_is_delivered_for_any_seed(seed: int) -> None:
    check(simulated(fidelity=Fidelity.KINEMATIC, seed=seed))


@pytest.mark.parametrize("fidelity", PLANAR)
def test_a_fleet_on_the_medium_site(fidelity: Fidelity) -> None:
    check(simulated(fidelity=fidelity, site="medium", robots=20, tasks=40))


@pytest.mark.parametrize("fidelity", PLANAR)
def test_the_same_seed_is_the_same_run(fidelity: Fidelity) -> None:
    hashes = [simulated(fidelity=fidelity, seed=seed, duration_s=60.0).state_hash for seed in (3, 3, 4)]
    assert hashes[0] == hashes[1] != hashes[2]


@pytest.mark.parametrize("fidelity", PLANAR)
def test_orders_from_a_file(fidelity: Fidelity, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """All of the file is delivered, in its own sizes; times, stations and odd names included."""
    draw = random.Random(5)
    rows = [
        f"order {k}/{draw.choice('äöü')},{k * 4.5},pick_{draw.randint(1, 2)},drop_{draw.randint(1, 2)},"
        f"{draw.uniform(0.05, 2):.2f},{draw.uniform(0.04, 0.1):.3f}"
        for k in range(12)
    ]
    orders = tmp_path / "orders.csv"
    orders.write_text("\ufeffid,release_s,pick,drop,mass_kg,size_m\r\n" + "\r\n".join(rows), encoding="utf-8")
    demo(["--fidelity", fidelity, "--orders", str(orders), "--out", str(tmp_path)])
    result = json.loads((tmp_path / "result.json").read_text(encoding="utf-8"))
    assert (result["tasks_done"], result["tasks_total"]) == (12, 12)
    assert "12 of 12" in capsys.readouterr().out
    report = verify_recording(tmp_path / "recording.rrd")
    assert report.verified
    assert len([path for path in report.entities if path.startswith("/states/tasks/")]) == 12


def test_the_end_of_the_time_is_no_failure(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    demo(["--fidelity", "grid", "--duration", "20", "--no-record", "--out", str(tmp_path)])
    said = capsys.readouterr().out
    assert "tasks were left open: the time was up" in said
    assert "recording" not in said
    assert sorted(path.name for path in tmp_path.iterdir()) == ["result.json", "run.jsonl", "run.trace"]


def test_a_second_run_replaces_the_files_of_the_first(tmp_path: Path) -> None:
    demo(["--fidelity", "grid", "--duration", "5", "--out", str(tmp_path)])
    demo(["--fidelity", "grid", "--duration", "5", "--seed", "1", "--no-record", "--out", str(tmp_path)])
    assert sorted(path.name for path in tmp_path.iterdir()) == ["result.json", "run.jsonl", "run.trace"]
    assert json.loads((tmp_path / "result.json").read_text(encoding="utf-8"))["seed"] == 1


@pytest.mark.parametrize("fidelity", WHOLE)
def test_a_run_that_is_closed_says_so(fidelity: Fidelity) -> None:
    simulation = Simulation(RunConfig(site="cell", robots=1, arms=ArmConfig(workers_n=0), fidelity=fidelity))
    simulation.tick()
    simulation.close()
    with pytest.raises(FleetError, match="tick 1 of a run that is closed"):
        simulation.tick()
