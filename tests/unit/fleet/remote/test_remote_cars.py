"""RemoteCars: a car in other hands goes where it is told, within cells that it can get, and comes back."""

import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

from fleet.config import ArmConfig, Fidelity, RunConfig
from fleet.missions.phases import CarPhase
from fleet.remote.errors import RemoteError
from fleet.run.events import Event
from fleet.safety.check import SafetyCheck
from fleet.simulation import Simulation

CONFIG = RunConfig(
    site="small", robots=2, tasks=1, fidelity=Fidelity.KINEMATIC, duration_s=600.0, arms=ArmConfig(workers_n=0)
)


@pytest.fixture
def run() -> Iterator[Simulation]:
    with Simulation(CONFIG) as simulation:
        yield simulation


def drive(run: Simulation, speed_mps: float, steering_rad: float, seconds: float, car: int = 0) -> None:
    """Tell a car the same in every tick."""
    for _ in range(round(seconds / run.tick_s)):
        run.remote.cars.drive(car, speed_mps, steering_rad)
        run.tick()


def pursue(run: Simulation, x: float, y: float, speed_mps: float = 0.4, car: int = 0) -> None:
    """Let a car drive towards a point, until it is near or 20 s are over."""
    for _ in range(round(20.0 / run.tick_s)):
        at_x, at_y, yaw = run.world.car_poses()[car].tolist()
        away = math.hypot(x - at_x, y - at_y)
        if away < 0.3:
            return
        turn = math.remainder(math.atan2(y - at_y, x - at_x) - yaw, math.tau)
        steering = math.atan(2.0 * run.scene.car.wheelbase_m * math.sin(turn) / max(away, 0.5))
        run.remote.cars.drive(car, speed_mps, steering)
        run.tick()


def cells_under(run: Simulation, car: int) -> set[int]:
    grid = run.site.grid
    x, y, _ = run.world.car_poses()[car].tolist()
    return {int(grid.index(grid.rows - 1 - math.floor(y), math.floor(x)))}


def test_a_car_goes_as_told_and_stands_when_nobody_tells_it_more(run: Simulation) -> None:
    run.remote.cars.take(0)
    before = run.world.car_poses()[0].copy()
    drive(run, 0.4, 0.0, 2.0)
    after = run.world.car_poses()[0].copy()
    assert np.hypot(*(after - before)[:2]) == pytest.approx(0.7, abs=0.15)
    for _ in range(120):
        run.tick()
    rest = run.world.car_poses()[0]
    assert abs(run.world.car_speeds()[0]) < 0.01
    assert np.hypot(*(rest - after)[:2]) < 0.35
    assert run.missions.phase[0] is CarPhase.RECOVERING


def test_it_holds_the_cells_it_is_in_and_gives_back_those_behind_it() -> None:
    with Simulation(replace(CONFIG, robots=1)) as run:
        run.remote.cars.take(0)
        seen = [cells_under(run, 0)]
        for x, y in ((3.5, 10.3), (4.5, 9.5), (6.0, 9.5), (8.0, 9.5)):
            pursue(run, x, y)
            seen.append(cells_under(run, 0))
            held = set(run.executor.dependencies.held_cells(0))
            assert seen[-1] <= held
            assert len(held) <= 3
        assert not seen[0] & held
        assert np.hypot(*(run.world.car_poses()[0, :2] - (8.0, 9.5))) < 0.3


def test_it_is_stopped_before_a_cell_of_another_unless_it_is_trusted() -> None:
    ends = []
    for trusted in (False, True):
        with Simulation(CONFIG) as run:
            x, y, yaw = run.world.car_poses()[0].tolist()
            grid = run.site.grid
            ahead = int(grid.index(grid.rows - 1 - math.floor(y + math.sin(yaw)), math.floor(x + math.cos(yaw))))
            assert run.executor.dependencies.reserve(1, (ahead,))
            told: list[Event] = []
            run.events.subscribe(told.append)
            run.remote.cars.take(0, trusted=trusted)
            drive(run, 0.8, 0.0, 2.0)
            ends.append(np.hypot(*(run.world.car_poses()[0, :2] - (x, y))))
            stops = [event.facts["cause"] for event in told if event.kind == "remote_stopped"]
            if not trusted:
                assert stops == [f"{grid.words(ahead)} is held by car_1"]
                assert ahead not in cells_under(run, 0)
    assert ends[0] < 0.6 < ends[1]


def test_it_does_not_leave_the_floor(run: Simulation) -> None:
    run.remote.cars.take(0)
    for _ in range(3):
        drive(run, -1.0, 0.0, 3.0)
        drive(run, 1.5, 0.3, 6.0)
    assert run.world.contacts().static == 0
    free = run.site.grid.free.ravel()
    assert all(free[cell] for cell in cells_under(run, 0))


def test_given_back_it_finds_its_lane_and_all_is_done() -> None:
    with Simulation(replace(CONFIG, tasks=4)) as run:
        check = SafetyCheck(run.view)
        run.remote.cars.take(0)
        for _ in range(180):
            run.remote.cars.drive(0, 0.4, 0.1)
            run.tick()
            check.tick()
        run.remote.cars.give_back(0)
        while not run.finished:
            run.tick()
            check.tick()
        assert run.summary().tasks_done == 4
        assert run.summary().robot_contacts == 0
        assert run.missions.phase[0] is not CarPhase.RECOVERING


def test_what_cannot_be_is_refused_by_name(run: Simulation) -> None:
    with pytest.raises(RemoteError, match="car_1 was not taken; valid: a car that was taken"):
        run.remote.cars.drive(1, 0.5, 0.0)
    run.remote.cars.take(1)
    with pytest.raises(RemoteError, match="finite numbers"):
        run.remote.cars.drive(1, math.nan, 0.0)
    run.lose_car(0, "a test")
    with pytest.raises(RemoteError, match="car_0 is dead"):
        run.remote.cars.take(0)
    run.lose_car(1, "a test")
    run.tick()
    assert run.remote.cars.taken == []
    with Simulation(replace(CONFIG, fidelity=Fidelity.GRID)) as grid, pytest.raises(RemoteError, match="--fidelity"):
        grid.remote.cars.take(0)
