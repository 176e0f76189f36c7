"""RemoteArms: an arm in other hands follows what it is told inside its limits, over a dock that is closed meanwhile."""

from collections.abc import Iterator

import numpy as np
import pytest

from fleet.arrays import FloatArray
from fleet.config import ArmConfig, Fidelity, RunConfig
from fleet.remote.errors import RemoteError
from fleet.simulation import Simulation

CONFIG = RunConfig(
    site="cell", robots=1, tasks=2, fidelity=Fidelity.KINEMATIC, duration_s=600.0, arms=ArmConfig(workers_n=0)
)


@pytest.fixture
def run() -> Iterator[Simulation]:
    with Simulation(CONFIG) as simulation:
        yield simulation


def taken(run: Simulation, *, trusted: bool = False) -> None:
    """Let arm_0 be in other hands."""
    run.remote.arms.take(0, trusted=trusted)
    while run.executor.closed[int(run.graph.state_cell[run.stations[0].dock_state])] == run.arm_manager.is_idle(0):
        run.tick()


def turned(run: Simulation, by_rad: float = 0.3) -> FloatArray:
    return turn(run.scene.arms.specs[0].home_rad, 6, by_rad)


def turn(q: FloatArray, joint: int, by_rad: float) -> FloatArray:
    changed = q.copy()
    changed[joint] += by_rad
    return changed


def test_an_arm_goes_to_its_target_inside_its_limits_and_comes_home(run: Simulation) -> None:
    taken(run)
    goal, spec = turned(run), run.scene.arms.specs[0]
    run.remote.arms.aim(0, goal)
    q = [run.arm_manager.q[0].copy()]
    for _ in range(120):
        run.tick()
        q.append(run.arm_manager.q[0].copy())
    speeds = np.diff(q, axis=0) / run.tick_s
    assert np.abs(q[-1] - goal).max() < 1e-9
    assert (np.abs(speeds) <= spec.max_velocity_radps + 1e-9).all()
    assert (np.abs(np.diff(speeds, axis=0)) <= 1.5 * spec.max_acceleration_radps2 * run.tick_s + 1e-9).all()
    assert np.abs(run.world.arm_positions()[0] - goal).max() < 0.01
    run.remote.arms.give_back(0)
    while not run.finished:
        run.tick()
    assert run.remote.arms.taken == []
    assert run.summary().tasks_done == 2


def test_an_arm_puts_back_what_it_has_fetched_for_a_car_that_will_not_come(run: Simulation) -> None:
    while run.arm_manager.services[0].state != "holding":
        run.tick()
    taken(run)
    assert run.sim_s < 20.0
    assert (run.world.held() == -1).all()


def test_a_motion_goes_through_its_points_in_their_time(run: Simulation) -> None:
    taken(run)
    points = [turned(run, 0.2), turned(run, -0.2)]
    run.remote.arms.follow(0, [1.0, 2.0], points)
    for second, point in enumerate(points, 1):
        for _ in range(round(1.0 / run.tick_s)):
            run.tick()
        assert run.arm_manager.q[0] == pytest.approx(point, abs=1e-6), second


def test_the_station_waits_while_its_arm_is_in_other_hands(run: Simulation) -> None:
    taken(run)
    for _ in range(round(30.0 / run.tick_s)):
        run.tick()
    assert run.summary().tasks_done == 0
    dock = int(run.graph.state_cell[run.stations[0].dock_state])
    assert run.executor.closed[dock]


@pytest.mark.parametrize(
    ("times", "change", "words"),
    [
        ([1.0], lambda q: q[:-1], "rows of 7 finite numbers"),
        ([1.0], lambda q: q * np.nan, "rows of 7 finite numbers"),
        ([1.0], lambda q: turn(q, 0, 9.0), "joint_1 is .* rad; valid: -2.96.* to 2.96"),
        ([0.05], lambda q: turn(q, 6, 1.0), "joint_7 at 20.000 rad/s; valid: at most"),
        ([0.0], lambda q: turn(q, 6, 1.0), "first point at once"),
        ([-1.0], lambda q: q, "ascending numbers >= 0"),
        (["soon"], lambda q: q, "ascending numbers >= 0"),
    ],
)
def test_a_motion_that_cannot_be_is_refused_by_name(run: Simulation, times, change, words: str) -> None:
    taken(run)
    with pytest.raises(RemoteError, match=words):
        run.remote.arms.follow(0, times, [change(run.scene.arms.specs[0].home_rad)])


def test_an_arm_that_would_come_down_over_a_lane_is_stopped_unless_it_is_trusted(run: Simulation) -> None:
    taken(run)
    low = np.array([0.0, 1.9, 0.0, -0.1, 0.0, 0.0, 0.0])

    def aim_everywhere() -> None:
        for angle in np.linspace(-2.5, 2.5, 21):
            run.remote.arms.aim(0, turn(low, 0, angle))

    with pytest.raises(RemoteError, match="over the lane in"):
        aim_everywhere()
    run.remote.arms.take(0, trusted=True)
    aim_everywhere()


def test_an_arm_that_was_not_taken_is_the_fleets(run: Simulation) -> None:
    with pytest.raises(RemoteError, match="arm_0 is in the hands of the fleet"):
        run.remote.arms.aim(0, run.scene.arms.specs[0].home_rad)
