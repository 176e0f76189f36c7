"""Published problems of the League of 2026: all are read, and what is played on one of them is legal."""

from __future__ import annotations

import json
import os
from pathlib import Path

import pytest

from fleet.league.controller import PibtController
from fleet.league.ticks.play_ticks import play_ticks
from maps.formats.lorr import read_problem, write_result
from tests.unit.fleet.league.ticks.replay_ticks import complaints

INSTANCES = Path(os.environ.get("FLEET_INSTANCES", Path(__file__).parents[3] / "shared" / "instances")) / "lorr2026"
"""The folder `example_problems` of the League's start kit 3.1.0, beside the repository; it is not part of it."""
PROBLEMS = {
    "city.domain/bos-example_600": (600, 900, 3600),
    "game.domain/orz-example_1800": (1800, 2700, 7200),
    "iron_harvest.domain/iron-example_10000": (10_000, 10_000, 25_000),
    "maze.domain/maze-example_40": (40, 60, 160),
    "random.domain/random-example_400": (400, 600, 3200),
    "room.domain/room-example_150": (150, 225, 1375),
    "warehouse.domain/fulfill-example_2500": (2500, 3750, 22_500),
}
"""Robots, tasks that are known at a time, and tasks of the file."""

pytestmark = pytest.mark.skipif(
    not INSTANCES.is_dir(), reason=f"no {INSTANCES}; set FLEET_INSTANCES to the folder that holds lorr2026"
)


@pytest.mark.parametrize("name", PROBLEMS)
def test_a_published_problem_is_read(name: str) -> None:
    problem = read_problem(INSTANCES / f"{name}.json")
    assert (problem.n_robots, problem.pool_size, problem.n_tasks) == PROBLEMS[name]
    assert problem.ticks is not None
    assert (problem.ticks.per_action, problem.ticks.size) == (3, 1.0)


def test_a_published_problem_is_played_by_the_rules(tmp_path: Path) -> None:
    played = play_ticks(read_problem(INSTANCES / "random.domain/random-example_400.json"), PibtController(), 300, 1.0)
    write_result(tmp_path / "out.json", played.result)
    result = json.loads((tmp_path / "out.json").read_text())
    assert (complaints(result), played.conflicts) == ([], ())
    assert result["numTaskFinished"] > 60
