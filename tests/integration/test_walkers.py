"""Cars on legs beside others: they walk the lanes, inspect, carry parcels on their backs, and are put back exactly."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from fleet.config import ArmConfig, CarConfig, Fidelity, RunConfig
from fleet.robots import CARS, CarModels
from fleet.run.events import Event
from fleet.session import SessionConfig, run_session
from fleet.simulation import Simulation
from fleet.world.bullet.cars import Cars, CarSteps
from fleet.world.bullet.vehicles.floor import BareFloor

WALKER = CarConfig(model="a1", capabilities=("walks",))
TICK_S = 1 / 60


class Walk:
    """An A1 and a Husky in an engine of their own."""

    def __init__(self) -> None:
        self.floor = BareFloor()
        entries = [CARS["a1"], CARS["husky"]]
        models = CarModels(kinds=tuple(entry.spec() for entry in entries), kind_of=np.array([0, 1]))
        start = np.array([[0.0, 0.0, 0.3], [3.0, 0.0, 0.0]])
        urdfs = [entry.urdf("sphere") for entry in entries]
        self.cars = Cars(self.floor.client, models, start, urdfs, CarSteps(length_s=self.floor.step_s, tick_s=TICK_S))

    def go(self, turn: float, speed: float, n_ticks: int) -> np.ndarray:
        """Tell the walker a yaw rate and a speed, the Husky to stand; give the walker's pose then."""
        for _ in range(n_ticks):
            self.cars.drive(np.array([[turn, speed], [0.0, 0.0]]))
            for _ in range(round(TICK_S / self.floor.step_s)):
                self.cars.before_step()
                self.floor.step()
            self.cars.now = self.cars.reading()
        return self.cars.now.poses[0].copy()


@pytest.mark.bullet
def test_a_walker_goes_as_fast_as_it_is_told_and_stands_still_where_it_stops() -> None:
    walk = Walk()
    first, second = walk.go(0.0, 0.4, 60), walk.go(0.0, 0.4, 120)
    assert np.hypot(*(second - first)[:2]) == pytest.approx(0.8, rel=0.05)
    stood = walk.go(0.0, 0.0, 60)
    later = walk.go(0.0, 0.0, 120)
    assert np.hypot(*(later - stood)[:2]) < 0.002
    assert walk.cars.now.frames[0, 2, 3] == pytest.approx(0.0, abs=0.01)  # its frame is on the floor, not in its trunk


@pytest.mark.bullet
def test_a_walker_that_is_put_elsewhere_stands_there() -> None:
    walk = Walk()
    walk.go(0.3, 0.3, 45)
    walk.cars.put(0, np.array([5.0, -2.0, 1.0]))
    np.testing.assert_allclose(walk.cars.now.poses[0], [5.0, -2.0, 1.0], atol=1e-6)
    np.testing.assert_allclose(walk.go(0.0, 0.0, 60), [5.0, -2.0, 1.0], atol=0.005)


@pytest.mark.bullet
def test_a_walker_s_gait_is_part_of_what_a_world_remembers() -> None:
    walk = Walk()
    walk.go(0.1, 0.4, 40)
    numbers, memory = walk.cars.state(), walk.cars.memory()
    went_on = walk.go(0.1, 0.4, 30)
    walk.go(-0.4, 0.0, 30)
    walk.cars.place(numbers)
    walk.cars.recall(memory)
    # The solver's memory of contacts is not restored.
    np.testing.assert_allclose(walk.go(0.1, 0.4, 30), went_on, atol=2e-3)


@pytest.fixture
def orders(tmp_path: Path) -> Path:
    """Return a patrol and an inspection for whoever walks, and a parcel that asks for its back."""
    path = tmp_path / "orders.json"
    shared = {"release_s": 0, "needs": "walks"}
    parcel = {"pick": "pick_1", "drop": "drop_1", "mass_kg": 2.0, "size_m": "0.08"}
    path.write_text(
        json.dumps(
            [
                {"id": "look", "type": "inspect", "places": "drop_2", **shared},
                {"id": "round", "type": "patrol", "places": ["drop_1", "pick_2"], **shared},
                {"id": "back", **parcel, **shared},
                {"id": "light", "release_s": 0, "pick": "pick_2", "drop": "drop_2", "mass_kg": 0.4, "size_m": "0.06"},
            ]
        )
    )
    return path


@pytest.mark.parametrize("fidelity", [Fidelity.GRID, Fidelity.KINEMATIC])
def test_a_walker_inspects_patrols_and_carries_without_physics(
    orders: Path, tmp_path: Path, fidelity: Fidelity
) -> None:
    config = RunConfig(
        site="small", robots=2, cars={"car_1": WALKER}, orders=orders, fidelity=fidelity, seed=3, duration_s=900.0
    )
    result = run_session(config, SessionConfig(out=tmp_path / "out", record=True, check=True))
    assert (result.tasks_done, result.robot_contacts, result.static_contacts) == (4, 0, 0)


@pytest.mark.bullet
def test_an_arm_lays_a_parcel_on_a_walker_s_back_in_physics(tmp_path: Path) -> None:
    path = tmp_path / "orders.csv"
    path.write_text("id,release_s,pick,drop,mass_kg,size_m\nback,0,pick_1,drop_1,2.0,0.08\n")
    config = RunConfig(site="cell", robots=1, cars={"car_0": WALKER}, orders=path, seed=1, duration_s=300.0)
    result = run_session(config, SessionConfig(out=tmp_path / "out", record=False, check=True))
    assert (result.tasks_done, result.robot_contacts, result.static_contacts) == (1, 0, 0)


@pytest.mark.bullet
def test_a_walker_that_was_pushed_off_its_lane_comes_back() -> None:
    config = RunConfig(site="small", robots=1, cars={"car_0": WALKER}, seed=2, duration_s=60.0, tasks=2)
    heard: list[Event] = []
    with Simulation(replace(config, arms=ArmConfig(workers_n=0)), on_event=heard.append) as simulation:
        while simulation.sim_s < 4.0:
            simulation.tick()
        simulation.world.push_car(0, 0.0, 0.24, 0.0)  # while it turns on the spot, and as hard as it survives
        while simulation.sim_s < 40.0 and "rejoined" not in [event.kind for event in heard]:
            simulation.tick()
        assert {"off_lane", "rejoined"} <= {event.kind for event in heard}
        assert simulation.world.contacts().static == 0
