"""Cars of a yard deliver without touching, as kinematic cars; and what a run says of itself is true."""

from dataclasses import replace

import pytest

from fleet.errors import ConfigError
from fleet.world.kinematic import KinematicWorld
from fleet.yard.run import YardResult, YardRun
from maps.yard import Yard, load_yard
from planners.open_floor import OpenFloorError


@pytest.fixture(scope="module")
def depot() -> Yard:
    """Return the yard that ships."""
    return load_yard("depot")


def played(yard: Yard, n_cars: int, duration_s: float, seed: int) -> YardResult:
    run = YardRun(yard, n_cars, KinematicWorld, seed=seed)
    while run.time_s < duration_s:
        run.tick()
    return run.result()


def test_cars_deliver_without_touching_and_the_same_seed_is_the_same_run(depot: Yard) -> None:
    first = played(depot, 8, 30.0, 0)
    assert first.deliveries >= 1
    assert first.contacts == 0
    assert first.min_clearance_m > 0.05
    assert first.most_beside_m < 0.08
    assert first.longest_still_s < 10.0
    assert played(depot, 8, 30.0, 0) == first


def test_as_many_cars_as_spots_are_refused(depot: Yard) -> None:
    with pytest.raises(ConfigError, match="--cars is 28; valid: 1 to 27, one fewer than yard depot has spots"):
        YardRun(depot, 28, KinematicWorld)


def test_spots_that_are_too_near_are_refused(depot: Yard) -> None:
    near = depot.spots.copy()
    near[1, 1] = near[0, 1] + 0.4
    with pytest.raises(OpenFloorError, match=r"cars stand nearer than 0\.18 m to something"):
        YardRun(replace(depot, spots=near), 3, KinematicWorld)
