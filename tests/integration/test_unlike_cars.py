"""Cars of several models in one run: heavy orders go to cars that carry them, and nobody touches anybody."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from fleet.config import ArmConfig, CarConfig, Connect, Fidelity, RunConfig
from fleet.errors import ConfigError
from fleet.robots import CARS
from fleet.run.setup import RunSetup
from fleet.session import SessionConfig, run_session
from fleet.simulation import Simulation
from fleet.tasks.board import TaskState
from fleet.tasks.reasons import PairReason
from tests import hauler

HEADER = "id,release_s,pick,drop,mass_kg,size_m\n"
HAULER = CarConfig(model="hauler")


@pytest.fixture(autouse=True)
def with_a_hauler(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(CARS, "hauler", hauler.ENTRY)


@pytest.fixture
def orders(tmp_path: Path) -> Path:
    """Return six orders, the second and the fifth of which are heavy."""
    path = tmp_path / "orders.csv"
    rows = [f"o{k},0,pick_{k % 2 + 1},drop_{(k + 1) % 2 + 1},{2.5 if k in (1, 4) else 0.4},0.08\n" for k in range(6)]
    path.write_text(HEADER + "".join(rows))
    return path


def carriers(simulation: Simulation) -> dict[str, int | None]:
    return {task.order.name: task.car for task in simulation.board.tasks}


def test_heavy_orders_go_to_the_car_that_carries_them_without_physics(orders: Path, tmp_path: Path) -> None:
    config = RunConfig(robots=4, cars={"car_2": HAULER}, orders=orders, fidelity=Fidelity.KINEMATIC, seed=3)
    result = run_session(config, SessionConfig(out=tmp_path / "out", record=True, check=True))
    assert (result.tasks_done, result.robot_contacts, result.static_contacts) == (6, 0, 0)
    with Simulation(replace(config, arms=ArmConfig(workers_n=0))) as simulation:
        had = {}
        while not simulation.finished:
            simulation.tick()
            had |= {name: car for name, car in carriers(simulation).items() if car is not None}
        assert had["o1"] == had["o4"] == 2
        assert {had[name] for name in ("o0", "o2", "o3", "o5")} - {2}


def test_a_pair_that_is_too_heavy_has_that_reason(orders: Path) -> None:
    config = RunConfig(robots=2, cars={"car_1": HAULER}, orders=orders, fidelity=Fidelity.GRID)
    with Simulation(replace(config, arms=ArmConfig(workers_n=0))) as simulation:
        while simulation.board.named("o1").state in (TaskState.ORDERED, TaskState.BACKLOG, TaskState.READY):
            simulation.tick()
        report = simulation.explain_assignment("o1")
        assert [pair.reason for pair in report.pairs] == [PairReason.TOO_HEAVY, PairReason.CHOSEN]


def test_both_models_deliver_in_physics(tmp_path: Path) -> None:
    path = tmp_path / "orders.csv"
    path.write_text(HEADER + "light,0,pick_1,drop_1,0.4,0.06\nheavy,0,pick_2,drop_2,2.5,0.08\n")
    config = RunConfig(robots=2, cars={"car_1": HAULER}, orders=path, seed=1, duration_s=150.0)
    result = run_session(config, SessionConfig(out=tmp_path / "out", record=False, check=True))
    assert (result.tasks_done, result.robot_contacts, result.static_contacts) == (2, 0, 0)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"front_m": 0.95}, "model hauler: its body of 1.02 x 0.44 m"),
        ({"max_steering_rad": 0.5}, "which turns in 0.70 m, fits no lane to station"),
    ],
)
def test_a_model_that_does_not_fit_is_refused(
    change: dict[str, float], words: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    unfit = replace(hauler.ENTRY, spec=lambda: replace(hauler.hauler_spec(), **change))
    monkeypatch.setitem(CARS, "hauler", unfit)
    with pytest.raises(ConfigError) as refused:
        RunSetup.of(RunConfig(robots=2, cars={"car_1": HAULER}))
    assert words in str(refused.value)
    assert "; valid: " in str(refused.value)


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"fidelity": Fidelity.MIXED}, "--fidelity is 'mixed'; valid: physics, kinematic or grid"),
        ({"site": "medium", "robots": 61, "connect": Connect.DIRECT}, "--robots is 61; valid: 1 to 60 in physics"),
    ],
)
def test_cars_of_several_models_are_refused_where_they_cannot_be(settings: dict[str, object], words: str) -> None:
    with pytest.raises(ConfigError, match=words):
        RunSetup.of(RunConfig(**({"robots": 2, "cars": {"car_1": HAULER}} | settings)))  # type: ignore[arg-type]


def test_a_car_may_not_carry_more_than_its_model_and_one_must_carry_what_is_generated() -> None:
    with pytest.raises(ConfigError, match=r"cars.car_0.max_payload_kg is 2.5; valid: at most 2"):
        Simulation(RunConfig(robots=1, cars={"car_0": CarConfig(max_payload_kg=2.5)}, fidelity=Fidelity.GRID))
    with pytest.raises(ConfigError, match=r"payload of the cars is 0.4; valid: a car that carries 0.5 kg"):
        Simulation(RunConfig(robots=1, cars={"car_0": CarConfig(max_payload_kg=0.4)}, fidelity=Fidelity.GRID))
