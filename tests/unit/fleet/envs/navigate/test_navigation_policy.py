"""Scripts that drive: pursuit, and pursuit that backs out."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from fleet.envs import navigate_v1
from fleet.envs.navigate.navigation_policy import BackingPolicy, PursuitPolicy
from fleet.envs.navigate.rows import FIRST_OTHER, N_CAR_NUMBERS, N_OWN, NEAR_M, WAY_POINTS_M

Row = npt.NDArray[np.float32]


def car_at(*, speed: float = 0.0, steering: float = 0.0, way_rad: float = 0.0, touches: bool = False) -> Row:
    """What a car sees that is alone; its way leads off straight at an angle."""
    row = np.zeros(N_CAR_NUMBERS, dtype=np.float32)
    row[0], row[1], row[5] = speed, steering, touches
    for k, far_m in enumerate(WAY_POINTS_M):
        row[N_OWN + 2 * k : N_OWN + 2 * k + 2] = np.array([np.cos(way_rad), np.sin(way_rad)]) * far_m / 3.0
    return row


def before(row: Row, *, heading_rad: float, lower: bool) -> Row:
    """The same with another car 0.6 m ahead."""
    row = row.copy()
    row[FIRST_OTHER : FIRST_OTHER + 5] = 1.0, 0.6 / NEAR_M, 0.0, np.cos(heading_rad), np.sin(heading_rad)
    row[FIRST_OTHER + 15] = lower
    return row


def speed_of(row: Row) -> float:
    return float(BackingPolicy().actions(row[None])[0, 1])


def test_a_nose_at_a_wall_backs_away_from_where_the_way_leads() -> None:
    steering, speed = BackingPolicy().actions(car_at(steering=1.0, way_rad=1.5)[None])[0]
    assert speed < 0.0
    assert steering == -1.0
    assert PursuitPolicy().actions(car_at(steering=1.0, way_rad=1.5)[None])[0, 1] > 0.0


def test_it_backs_until_the_way_lies_ahead_and_goes_on_if_its_back_is_stopped() -> None:
    assert speed_of(car_at(speed=-0.2, steering=-1.0, way_rad=0.5)) < 0.0
    assert speed_of(car_at(speed=-0.2, steering=-1.0, way_rad=0.1)) > 0.0
    assert speed_of(car_at(speed=0.0, steering=-1.0, way_rad=1.5)) > 0.0


def test_of_two_nose_to_nose_the_one_with_the_greater_number_backs() -> None:
    one = car_at(touches=True)
    assert speed_of(before(one, heading_rad=np.pi, lower=True)) < 0.0
    assert speed_of(before(one, heading_rad=np.pi, lower=False)) >= 0.0


def test_one_that_ran_into_another_from_behind_backs() -> None:
    assert speed_of(before(car_at(touches=True), heading_rad=0.0, lower=False)) < 0.0
    assert speed_of(before(car_at(), heading_rad=0.0, lower=False)) >= 0.0


def test_as_long_as_cars_move_it_is_the_pursuit() -> None:
    env = navigate_v1.parallel_env(n_cars=4, max_cycles=100)
    seen, _ = env.reset(seed=0)
    moving = []
    while env.agents:
        moving.extend(row for row in seen.values() if row[0] > 0.02)
        seen, *_ = env.step(PursuitPolicy().act(env, seen))
    env.close()
    assert len(moving) > 200
    assert np.array_equal(BackingPolicy().actions(np.array(moving)), PursuitPolicy().actions(np.array(moving)))


def test_cars_that_are_knocked_off_their_courses_stand_less() -> None:
    def stood(policy: PursuitPolicy) -> int:
        env = navigate_v1.parallel_env(knocks_per_min=4.0)
        n = 0
        for seed in range(4):
            seen, _ = env.reset(seed=seed)
            while env.agents:
                n += sum(abs(row[0]) < 0.02 for row in seen.values())
                seen, *_ = env.step(policy.act(env, seen))
        env.close()
        return n

    assert stood(BackingPolicy()) < 0.5 * stood(PursuitPolicy())
