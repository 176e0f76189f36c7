"""Huskies beside racecars: cars that turn on the spot and have high trays drive, load and deliver in one run."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from fleet.config import ArmConfig, CarConfig, Fidelity, Perception, RunConfig
from fleet.errors import ConfigError
from fleet.run.setup import RunSetup
from fleet.session import SessionConfig, run_session
from fleet.simulation import Simulation
from maps.site import save_site
from maps.warehouse import generate_warehouse

HEADER = "id,release_s,pick,drop,mass_kg,size_m\n"
HUSKY = CarConfig(model="husky")


@pytest.fixture(scope="module")
def wide(tmp_path_factory: pytest.TempPathFactory) -> str:
    """Return a floor with lanes of 1.25 m, in which a Husky may turn."""
    path = tmp_path_factory.mktemp("site") / "wide.toml"
    save_site(generate_warehouse(rows=12, cols=16, pick=2, drop=2, parking=6, rack_cols=3, cell_m=1.25), path)
    return str(path)


def orders_in(folder: Path, n: int, heavy: tuple[int, ...]) -> Path:
    path = folder / "orders.csv"
    rows = [
        f"o{k},0,pick_{k % 2 + 1},drop_{(k + 1) % 2 + 1},{2.5 if k in heavy else 0.4},{0.06 if k % 2 else 0.1}\n"
        for k in range(n)
    ]
    path.write_text(HEADER + "".join(rows))
    return path


def carriers(simulation: Simulation) -> dict[str, int]:
    """Play a run; the car that each order was with last."""
    had: dict[str, int] = {}
    while not simulation.finished:
        simulation.tick()
        had |= {task.order.name: task.car for task in simulation.board.tasks if task.car is not None}
    return had


def test_heavy_orders_go_to_the_husky_without_physics(wide: str, tmp_path: Path) -> None:
    path = orders_in(tmp_path, 6, heavy=(1, 4))
    config = RunConfig(
        site=wide, robots=4, cars={"car_2": HUSKY}, orders=path, fidelity=Fidelity.KINEMATIC, seed=3, duration_s=900.0
    )
    result = run_session(config, SessionConfig(out=tmp_path / "out", record=True, check=True))
    assert (result.tasks_done, result.robot_contacts, result.static_contacts) == (6, 0, 0)
    with Simulation(replace(config, arms=ArmConfig(workers_n=0))) as simulation:
        had = carriers(simulation)
    assert had["o1"] == had["o4"] == 2
    assert {had[name] for name in ("o0", "o2", "o3", "o5")} - {2}


def test_a_husky_and_a_racecar_deliver_in_physics(wide: str, tmp_path: Path) -> None:
    path = tmp_path / "orders.csv"
    path.write_text(HEADER + "light,0,pick_1,drop_1,0.4,0.06\nheavy,0,pick_2,drop_2,2.5,0.1\n")
    config = RunConfig(site=wide, robots=2, cars={"car_1": HUSKY}, orders=path, seed=1, duration_s=300.0)
    result = run_session(config, SessionConfig(out=tmp_path / "out", record=False, check=True))
    assert (result.tasks_done, result.robot_contacts, result.static_contacts) == (2, 0, 0)


@pytest.mark.parametrize("fidelity", [Fidelity.KINEMATIC, Fidelity.PHYSICS])
def test_a_husky_that_was_pushed_comes_back_to_its_lane(wide: str, fidelity: Fidelity) -> None:
    config = RunConfig(site=wide, robots=1, cars={"car_0": HUSKY}, fidelity=fidelity, seed=2, duration_s=60.0, tasks=2)
    with Simulation(replace(config, arms=ArmConfig(workers_n=0))) as simulation:
        told = simulation.events
        kinds: list[str] = []
        told.subscribe(lambda event: kinds.append(event.kind))
        while simulation.sim_s < 4.0:
            simulation.tick()
        simulation.world.push_car(0, 0.2, 0.25, 0.5)
        while simulation.sim_s < 40.0 and "rejoined" not in kinds:
            simulation.tick()
        assert "off_lane" in kinds
        assert "rejoined" in kinds
        assert simulation.world.contacts().static == 0


def test_lanes_of_a_metre_are_too_narrow_for_a_husky() -> None:
    config = RunConfig(robots=2, cars={"car_1": HUSKY}, fidelity=Fidelity.KINEMATIC)
    with pytest.raises(
        ConfigError,
        match=r"model husky: its body of 0.99 x 0.69 m, which turns on the spot, fits no lane to .*; valid: ",
    ):
        RunSetup.of(config)


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"fidelity": Fidelity.MIXED}, "--fidelity is 'mixed'; valid: physics, kinematic or grid"),
        ({"perception": Perception.CAMERA}, "models with the same tray, as cameras are set up"),
    ],
)
def test_huskies_are_refused_where_they_cannot_be(settings: dict[str, object], words: str, wide: str) -> None:
    with pytest.raises(ConfigError, match=words):
        RunSetup.of(RunConfig(site=wide, robots=2, cars={"car_1": HUSKY}, **settings))  # type: ignore[arg-type]


def test_an_order_that_no_car_may_carry_is_refused_by_name(wide: str, tmp_path: Path) -> None:
    path = tmp_path / "orders.csv"
    path.write_text(HEADER + "light,0,pick_1,drop_1,0.4,0.06\nheavy,0,pick_2,drop_2,2.5,0.1\n")
    config = RunConfig(site=wide, robots=2, orders=path, fidelity=Fidelity.GRID, duration_s=10.0)
    result = run_session(config, SessionConfig(out=tmp_path / "out", record=False, check=True))
    assert any("line 3: mass_kg is '2.5'; valid: at most 2, the greatest" in line for line in result.orders_refused)


def test_speeds_and_turns_stay_within_the_limits(wide: str) -> None:
    config = RunConfig(
        site=wide, robots=1, cars={"car_0": HUSKY}, fidelity=Fidelity.KINEMATIC, seed=2, duration_s=40.0, tasks=2
    )
    with Simulation(replace(config, arms=ArmConfig(workers_n=0))) as simulation:
        drive = simulation.scene.cars[0].differential
        assert drive is not None
        limits, rims = drive.limits, []
        while not simulation.finished:
            simulation.tick()
            speed, turn = simulation.world.car_speeds()[0], simulation.world.car_steering()[0]
            rims.append(abs(speed) + limits.lever_m * abs(turn))
        assert max(rims) <= limits.max_rim_mps + 0.02
        assert np.abs(simulation.driver.paths.follower.cross_track).max() < 0.03  # type: ignore[union-attr]
