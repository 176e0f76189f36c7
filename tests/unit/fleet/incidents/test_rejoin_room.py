"""Where a car may manoeuvre: free of walls, of others and of what they hold, and out of where it should not be."""

import numpy as np
import pytest

from fleet.config import ArmConfig, Fidelity, RunConfig
from fleet.incidents.rejoin_room import LEAST_MARGIN_M, MARGIN_M, SWING_M, RejoinRoom
from fleet.simulation import Simulation

# On the cell site: the open row 7 (from below: y 1..2) with walls below y = 1 and shelves above x 3..5, y 2..3.
OPEN = (2.0, 1.5, 0.0)


@pytest.fixture(scope="module")
def simulation() -> Simulation:
    """Return a car in its parking place, and little else."""
    config = RunConfig(site="cell", robots=2, fidelity=Fidelity.KINEMATIC, arms=ArmConfig(workers_n=0))
    with Simulation(config) as simulation:
        simulation.tick()
        return simulation


def valid(room: RejoinRoom, *pose: float) -> bool:
    return bool(room.valid(np.array([pose]))[0])


def room_of(simulation: Simulation, start: tuple[float, float, float] = OPEN) -> RejoinRoom:
    grid = simulation.site.grid
    return RejoinRoom(simulation.view, 0, np.array(start), grid.free.copy())


def test_the_body_and_its_margin_keep_off_walls(simulation: Simulation) -> None:
    room, car = room_of(simulation), simulation.scene.car
    lowest = 1.0 + car.half_width_m + MARGIN_M
    assert valid(room, 4.0, lowest + 0.01, 0.0)
    assert not valid(room, 4.0, lowest - 0.01, 0.0)
    assert not valid(room, 4.0, 1.35, -np.pi / 2), "its nose would be in the wall"
    assert not valid(room, -5.0, 1.5, 0.0), "off the map"


@pytest.mark.parametrize("margin_m", [MARGIN_M, LEAST_MARGIN_M])
def test_a_corner_between_two_points_of_the_outline_is_not_missed(simulation: Simulation, margin_m: float) -> None:
    """The shelf's corner at (3, 3) from all sides: wherever the corner is inside the body, the pose is refused."""
    usable, car = simulation.site.grid.free.copy(), simulation.scene.car
    room = RejoinRoom(simulation.view, 0, np.array(OPEN), usable, margin_m)
    draw = np.random.default_rng(0)
    poses = np.column_stack([draw.uniform(2.2, 3.8, 4000), draw.uniform(2.2, 3.8, 4000), draw.uniform(-3.1, 3.1, 4000)])
    dx, dy = 3.0 - poses[:, 0], 3.0 - poses[:, 1]
    cos, sin = np.cos(poses[:, 2]), np.sin(poses[:, 2])
    ahead, left = cos * dx + sin * dy, cos * dy - sin * dx
    hit = (ahead < car.front_m) & (ahead > -car.rear_m) & (np.abs(left) < car.half_width_m)
    assert hit.sum() > 100
    assert not room.valid(poses)[hit].any()


def test_other_cars_are_kept_off(simulation: Simulation) -> None:
    x, y, yaw = simulation.driver.estimate[1]
    beside = (float(x) + 0.5, float(y), float(yaw))
    room = room_of(simulation, beside)
    car = simulation.scene.car
    assert valid(room, *beside)
    assert not valid(room, float(x) + 2 * car.half_width_m, float(y), float(yaw))
    assert not valid(room, float(x), float(y), float(yaw) + 1.0)


def test_cells_that_others_hold_are_kept_off_except_where_it_stands_already(simulation: Simulation) -> None:
    grid = simulation.site.grid
    usable = grid.free.copy()
    usable[grid.cell_at(3.5, 1.5)] = False
    room = RejoinRoom(simulation.view, 0, np.array(OPEN), usable)
    assert valid(room, *OPEN)
    assert valid(room, 2.55, 1.5, 0.0)
    assert not valid(room, 2.65, 1.5, 0.0), "its nose enters the cell"
    standing = RejoinRoom(simulation.view, 0, np.array([2.8, 1.5, 0.0]), usable)
    assert valid(standing, 2.8, 1.5, 0.0)
    assert valid(standing, 2.65, 1.5, 0.0)


def test_a_car_that_is_too_near_a_wall_may_only_get_out(simulation: Simulation) -> None:
    start = (4.0, 1.16, 0.0)
    room = room_of(simulation, start)
    assert valid(room, *start)
    assert not valid(room, 4.0, 1.15, 0.0), "nearer"
    assert not valid(room, 4.7, 1.16, 0.0), "as near, farther on"
    assert valid(room, 4.1, 1.17, 0.0)
    assert valid(room, 4.7, 1.25, 0.0)


def test_who_gets_out_no_other_way_may_swing_its_tail_towards_the_wall(simulation: Simulation) -> None:
    start, usable = (4.0, 1.13, 0.0), simulation.site.grid.free.copy()
    x, y, radius_m = *start[:2], 1.0
    turn = np.linspace(0.0, 0.6, 40)
    curve = np.stack((x + radius_m * np.sin(turn), y + radius_m * (1 - np.cos(turn)), turn), axis=-1)
    assert not room_of(simulation, start).valid(curve).all()
    room = RejoinRoom(simulation.view, 0, np.array(start), usable, LEAST_MARGIN_M).eased(swing_m=SWING_M)
    assert room.valid(curve).all()
    assert not room.valid(np.array([[4.1, 1.12, 0.0]])).any(), "nearer than a tail swings"


def test_a_car_that_is_in_a_wall_keeps_its_margin_to_other_cars(
    simulation: Simulation, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(simulation.driver, "estimate", np.array([OPEN, (4.5, 1.6, np.pi / 2)]))
    beside = 4.5 - simulation.scene.car.half_width_m - simulation.scene.car.front_m
    room = room_of(simulation, (beside - 0.25, 1.1, 0.0))
    assert valid(room, beside - 0.25, 1.1, 0.0)
    assert valid(room, beside - MARGIN_M - 0.01, 1.45, 0.0)
    assert not valid(room, beside - MARGIN_M + 0.01, 1.45, 0.0)


def test_the_foot_of_an_arm_is_kept_off(simulation: Simulation) -> None:
    """Who was pushed into the cells beside an arm may not go through its foot on the way out."""
    (foot_x, foot_y), car = simulation.scene.arm_base[0, :2], simulation.scene.car
    reach = simulation.scene.arms.specs[0].outline.foot_m + car.half_width_m
    x, y = float(foot_x), float(foot_y)
    room = room_of(simulation, (x, y + reach + 0.02, 0.0))
    assert room.touches
    assert valid(room, x, y + reach + 0.02, 0.0)
    assert valid(room, x, y + reach + 0.03, 0.0)
    assert not valid(room, x, y + reach + 0.018, 0.0), "nearer"
    assert not valid(room, x - 0.2, y + reach + 0.02, 0.3), "its body would be in the foot"


def test_who_may_touch_a_wall_is_known(simulation: Simulation) -> None:
    lowest = 1.0 + simulation.scene.car.half_width_m
    assert room_of(simulation, (4.0, lowest + 0.005, 0.0)).touches
    assert not room_of(simulation, (4.0, lowest + 0.015, 0.0)).touches


def test_a_car_whose_nose_touches_a_wall_does_not_come_to_it_with_its_tail(simulation: Simulation) -> None:
    car = simulation.scene.car
    nose_in = -0.1
    lowest = car.half_width_m * np.cos(nose_in) - car.front_m * np.sin(nose_in)
    start = (4.0, 1.0 + lowest, nose_in)
    room = room_of(simulation, start)
    assert room.touches
    assert valid(room, *start)
    flush_with_tail = 1.0 + car.half_width_m * np.cos(0.1) + car.rear_m * np.sin(0.1) + 0.001
    assert not valid(room, 4.05, flush_with_tail, 0.1)
    assert valid(room, 4.05, flush_with_tail + 0.015, 0.1)


def test_a_car_whose_corner_touches_a_wall_leaves_it_at_once(simulation: Simulation) -> None:
    """Forward along the wall its corner scrapes by the error of the follower: backwards it does not."""
    car = simulation.scene.car
    nose_in = -0.2
    lowest = car.half_width_m * np.cos(nose_in) - car.front_m * np.sin(nose_in)
    y = 1.0 + lowest
    room = room_of(simulation, (4.0, y, nose_in))
    leaving = room.leaving()
    assert valid(leaving, 4.0, y, nose_in)
    assert valid(room, 4.05, y, nose_in)
    assert not valid(leaving, 4.05, y, nose_in), "along the wall"
    back = (4.0 - 0.05 * np.cos(nose_in), y - 0.05 * np.sin(nose_in), nose_in)
    assert valid(leaving, *back)
