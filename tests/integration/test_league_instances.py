"""Published problems of the League: all are read, and what is played on them is legal by an independent replay."""

from __future__ import annotations

import json
import os
from pathlib import Path

import pytest

from fleet.league.arena import Arena
from fleet.league.controller import PibtController
from fleet.league.play import play
from maps.formats.lorr import read_problem, write_result
from tests.unit.fleet.league.replay import Replay

INSTANCES = Path(os.environ.get("FLEET_INSTANCES", Path(__file__).parents[3] / "shared" / "instances")) / "lorr2024"
"""Published data beside the repository; it is not part of it."""
PROBLEMS = {
    "RANDOM-01": (100, 150),
    "RANDOM-03": (400, 600),
    "brc202d_500": (500, 750),
    "sortation_large_2000": (2000, 3000),
    "warehouse_large_5000": (5000, 7500),
}
"""Robots, and tasks that are known at a time."""

pytestmark = pytest.mark.skipif(
    not INSTANCES.is_dir(), reason=f"no {INSTANCES}; set FLEET_INSTANCES to the folder that holds lorr2024"
)


@pytest.mark.parametrize("name", PROBLEMS)
def test_a_published_problem_is_read(name: str) -> None:
    problem = read_problem(INSTANCES / f"{name}.json")
    arena = Arena(problem)
    assert (problem.n_robots, len(arena.pool())) == PROBLEMS[name]
    assert problem.n_tasks == 100_000
    assert not problem.round_robin


def test_a_published_problem_is_played_by_the_rules(tmp_path: Path) -> None:
    played = play(read_problem(INSTANCES / "RANDOM-01.json"), PibtController(), 120, 1.0)
    write_result(tmp_path / "out.json", played.result)
    replay = Replay(INSTANCES / "RANDOM-01.json", tmp_path / "out.json")
    assert (replay.complaints, played.conflicts) == ([], ())
    assert replay.n_finished == json.loads((tmp_path / "out.json").read_text())["numTaskFinished"] > 40
