"""Pace: tasks by blocks of timesteps, and how long somebody stood."""

from __future__ import annotations

import numpy as np

from fleet.arrays import IntArray
from fleet.league.arena import NO_TASK, Arena
from fleet.league.controller import PibtController
from fleet.league.pace import finished_in_blocks, longest_stand
from fleet.league.play import play
from maps.formats.lorr import LeagueResult
from tests.unit.fleet.league.problems import problem_of, random_problem


def of_one_robot(steps: str, *, tasks_from: int = 0) -> LeagueResult:
    """A robot in a corridor that drives (F) or waits (W), with a task from some timestep on."""
    arena = Arena(problem_of(["........"], [0], [[7], [0]]))
    graph = arena.graph
    for k, step in enumerate(steps):
        state = int(arena.states[0])
        if step == "F":
            moves = graph.out_move[graph.out_ptr[state] : graph.out_ptr[state + 1]]
            ends = graph.move_to[moves]
            state = int(ends[graph.state_cell[ends] != graph.state_cell[state]][0])
        task: IntArray = np.array([0 if k >= tasks_from else NO_TASK], dtype=np.int32)
        arena.apply(np.array([state]), task)
    return arena.result(np.zeros(len(steps)))


def test_blocks_add_up_to_all_tasks_of_a_run() -> None:
    played = play(random_problem(0), PibtController(), 90, 60.0)
    blocks = finished_in_blocks(played.result, 30)
    assert blocks.shape == (3,)
    assert blocks.sum() == played.result.n_finished > 0


def test_a_task_counts_in_the_block_of_its_last_timestep() -> None:
    result = of_one_robot("WWFFFFFFFW")
    assert result.n_finished == 1
    assert finished_in_blocks(result, 3).tolist() == [0, 0, 1]
    assert finished_in_blocks(result, 9).tolist() == [1]
    assert finished_in_blocks(result, 20).tolist() == []


def test_standing_ends_with_a_drive() -> None:
    assert longest_stand(of_one_robot("WWFWWWFW")) == 3


def test_who_has_no_task_does_not_stand() -> None:
    assert longest_stand(of_one_robot("WWWWWW", tasks_from=4)) == 2
    assert longest_stand(of_one_robot("WWWWWW", tasks_from=9)) == 0


def test_a_run_of_no_timesteps_has_no_blocks() -> None:
    result = play(random_problem(1), PibtController(), 0, 60.0).result
    assert finished_in_blocks(result, 5).tolist() == []
    assert longest_stand(result) == 0
