"""Published instances of cars without lanes: which can be solved, that they are, and that another judge agrees."""

import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from maps.formats.clcbs import read_car_instance
from planners.open_floor import (
    BENCHMARK_CAR,
    CarWay,
    OpenFloorPlanner,
    OpenFloorProblem,
    breaches,
    generate_open_floor,
    illegal_poses,
)
from planners.status import Status

INSTANCES = Path(os.environ.get("FLEET_INSTANCES", Path(__file__).parents[3] / "shared" / "instances")) / "clcbs"


@pytest.fixture(scope="module")
def problems() -> list[OpenFloorProblem]:
    """Return the published problems with 20 cars among obstacles, by number."""
    files = sorted(
        INSTANCES.glob("map50by50/agents20/**/*obst25*.yaml"), key=lambda path: int(path.stem.rpartition("ex")[2])
    )
    if not files:
        pytest.skip(f"no {INSTANCES}; set FLEET_INSTANCES to the folder that holds clcbs")
    given = [read_car_instance(path) for path in files]
    return [
        OpenFloorProblem(size_m=one.size_m, car=BENCHMARK_CAR, starts=one.starts, goals=one.goals, discs=one.discs)
        for one in given
    ]


def test_23_of_60_published_problems_cannot_be_solved(problems: list[OpenFloorProblem]) -> None:
    """As was found by hand: with yaw as it stands in the files, counter-clockwise, it would be others."""
    illegal = [number for number, problem in enumerate(problems) if illegal_poses(problem)]
    assert len(problems) == 60
    assert illegal[:8] == [0, 4, 5, 6, 7, 13, 14, 21]
    assert len(illegal) == 23
    assert OpenFloorPlanner().plan(problems[0]).status is Status.INFEASIBLE


@pytest.mark.parametrize("number", [1, 9, 59])
def test_published_problems_are_solved(number: int, problems: list[OpenFloorProblem]) -> None:
    """In number 9 cars start within a hand of obstacles: searched with 16 checks they overlap between two."""
    plan = OpenFloorPlanner().plan(problems[number])
    assert plan.status is Status.FEASIBLE
    assert breaches(problems[number], plan) == []


def test_shapely_says_what_the_referee_says() -> None:
    shapely = pytest.importorskip("shapely")
    from benchmarks.interop.open_floor import legal_by_shapely

    problem = generate_open_floor(40.0, 6, 8, seed=1)
    plan = OpenFloorPlanner().plan(problem)
    assert breaches(problem, plan) == []
    assert legal_by_shapely(problem, plan, shapely)
    # A car that goes straight to its goal, as no car can, drives into others or into obstacles on the way.
    across = [np.hypot(*(goal - start)[:2]) for start, goal in zip(problem.starts, problem.goals, strict=True)]
    towards = [np.arctan2(*(goal - start)[1::-1]) for start, goal in zip(problem.starts, problem.goals, strict=True)]
    straight = tuple(
        CarWay(start=np.array([*start[:2], yaw]), legs=np.array([[length, length, 0.0]]))
        for start, yaw, length in zip(problem.starts, towards, across, strict=True)
    )
    wrong = replace(plan, ways=straight)
    places = [breach for breach in breaches(problem, wrong) if breach.kind in ("obstacle", "overlap")]
    assert places != []
    assert not legal_by_shapely(problem, wrong, shapely)
