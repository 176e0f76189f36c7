"""Cars that get one way after another do not touch, however late they are, and never wait in a ring."""

import numpy as np
import pytest

from planners.errors import PlanningError
from planners.open_floor import CarOutline, CarWay, FloorTraffic, OpenFloorConfig, OpenFloorError, OpenFloorProblem
from planners.open_floor.referee import illegal_poses

CAR = CarOutline(front_m=0.41, rear_m=0.09, half_width_m=0.14, turning_radius_m=0.5)
CONFIG = OpenFloorConfig(margin_radii=0.2, most_poses=6000)
SPOTS = np.array([[x, y, yaw] for y in np.arange(0.8, 5.4, 0.75) for x, yaw in ((0.6, np.pi), (7.4, 0.0))])


def floor_with(poses: np.ndarray, discs: np.ndarray | None = None) -> OpenFloorProblem:
    return OpenFloorProblem(
        size_m=(8.0, 6.0),
        car=CAR,
        starts=poses,
        goals=poses,
        discs=np.empty((0, 3)) if discs is None else discs,
        walled=True,
    )


def by_length(way: CarWay) -> CarWay:
    """The way of a car that never stands: its time is the length it has driven."""
    legs = way.legs[way.legs[:, 1] != 0].copy()
    legs[:, 0] = np.abs(legs[:, 1])
    return CarWay(start=way.start, legs=legs)


@pytest.mark.parametrize("seed", [0, 1])
def test_late_cars_are_waited_for(seed: int) -> None:
    """Each car stands still at random, now and then for long; none may ever be in another one, and all go on."""
    rng, n = np.random.default_rng(seed), 8
    at = rng.permutation(len(SPOTS))[:n]
    pillar = np.array([[4.0, 3.0, 0.3]])
    traffic = FloorTraffic(floor_with(SPOTS[at], pillar), CONFIG)
    poses, driven, late = SPOTS[at].copy(), np.zeros(n), np.zeros(n, dtype=np.int64)
    ways: list[CarWay | None] = [None] * n
    sent = np.zeros(n, dtype=np.int64)
    for _ in range(600):
        allowed = traffic.granted_m(driven)
        for car in range(n):
            if traffic.arrived(car):
                spot = int(rng.choice(np.setdiff1d(np.arange(len(SPOTS)), at)))
                way = traffic.send(car, poses[car], SPOTS[spot])
                if way is not None:
                    at[car], ways[car], driven[car], allowed[car] = spot, by_length(way), 0.0, 0.0
                    sent[car] += 1
        late = np.where(late > 0, late - 1, np.where(rng.random(n) < 0.01, rng.integers(5, 80, n), 0))
        step = np.where(late > 0, 0.0, rng.uniform(0.0, 0.06, n))
        driven = np.maximum(driven, np.minimum(driven + step, allowed))
        for car, way in enumerate(ways):
            if way is not None:
                poses[car] = way.poses([driven[car]])[0]
        assert illegal_poses(floor_with(poses.copy(), pillar)) == []
    assert sent.sum() >= 2 * n


def test_a_car_on_its_way_is_not_sent_elsewhere_and_cars_that_stand_too_near_are_refused() -> None:
    traffic = FloorTraffic(floor_with(SPOTS[:2]), CONFIG)
    assert traffic.send(0, SPOTS[0], SPOTS[7]) is not None
    with pytest.raises(PlanningError, match="car 0 is on its way; valid: a car that has arrived"):
        traffic.send(0, SPOTS[0], SPOTS[3])
    beside = SPOTS[:2].copy()
    beside[1] = SPOTS[0] + [0, 0.3, 0]
    with pytest.raises(OpenFloorError, match=r"cars stand nearer than 0\.1 m to something"):
        FloorTraffic(floor_with(beside), CONFIG)
    with pytest.raises(OpenFloorError, match=r"margin_radii = 0\.01; valid: more"):
        FloorTraffic(floor_with(SPOTS[:2]), OpenFloorConfig(margin_radii=0.01))


def test_a_car_without_a_way_stays_and_is_sent_later() -> None:
    """The goal is taken until the other has left."""
    traffic = FloorTraffic(floor_with(SPOTS[[0, 5]]), CONFIG)
    assert traffic.send(0, SPOTS[0], SPOTS[5]) is None
    assert traffic.arrived(0)
    assert traffic.send(1, SPOTS[5], SPOTS[8]) is not None
    assert traffic.send(0, SPOTS[0], SPOTS[5]) is not None


def test_who_was_planned_to_pass_first_is_waited_for() -> None:
    """Two ways cross in the middle; the one that is nearer does not move, so the other stops before the crossing."""
    starts = np.array([[0.6, 3.0, 0.0], [4.0, 1.0, np.pi / 2]])
    traffic = FloorTraffic(floor_with(starts), CONFIG)
    crossing = traffic.send(0, starts[0], np.array([7.0, 3.0, 0.0]))
    assert crossing is not None
    assert traffic.send(1, starts[1], np.array([4.0, 5.3, np.pi / 2])) is not None
    stopped = 0.0
    for _ in range(400):
        allowed = traffic.granted_m(np.array([stopped, 0.0]))
        stopped = max(stopped, min(stopped + 0.02, allowed[0]))
    nose = by_length(crossing).poses([stopped])[0][0] + CAR.front_m
    assert 4.0 - CAR.half_width_m - 0.3 < nose < 4.0 - CAR.half_width_m - 0.05
