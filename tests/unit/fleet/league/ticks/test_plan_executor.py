"""The executor keeps a plan's order in each cell, whoever is late, and only ever drops the end of what it was told."""

from __future__ import annotations

import numpy as np

from fleet.league.ticks.plan_executor import PlanExecutor
from maps.formats.lorr import FORWARD, LETTERS, WAIT
from maps.grid import EAST, SOUTH
from maps.lane_graph import LaneGraph, grid_lane_graph
from planners.mapf.multi_step.multi_step_pibt import MultiStepPibt
from planners.mapf.problem import Instance
from tests.unit.fleet.league.problems import ROOM, problem_of, random_problem

GRAPH = grid_lane_graph(problem_of(ROOM, [0], [[4]]).grid, "rotating")


def executor_of(*places: tuple[int, int], window: int = 9) -> PlanExecutor:
    return PlanExecutor(GRAPH, states(*places), window)


def states(*places: tuple[int, int]) -> np.ndarray:
    return np.array([GRAPH.state_at(cell, heading) for cell, heading in places], dtype=np.int32)


def letters(executor: PlanExecutor) -> str:
    return "".join(LETTERS[action] for action in executor.actions())


def end(executor: PlanExecutor, *robots: bool) -> None:
    executor.ended(np.array(robots))


def test_waits_of_a_plan_are_left_out_and_turns_are_actions() -> None:
    executor = executor_of((0, EAST))
    executor.take(np.array([states((0, EAST)), states((0, EAST)), states((0, SOUTH)), states((6, SOUTH))]))
    assert letters(executor) == "R"
    assert letters(executor) == "R", "until it has ended"
    end(executor, True)
    assert letters(executor) == "F"
    end(executor, True)
    assert letters(executor) == "W"


def test_a_follower_sets_out_with_its_leader_however_long_the_line() -> None:
    executor = executor_of((0, EAST), (1, EAST), (2, EAST))
    executor.take(np.array([states((0, EAST), (1, EAST), (2, EAST)), states((1, EAST), (2, EAST), (3, EAST))]))
    assert letters(executor) == "FFF"


def test_who_turns_off_is_not_followed_before_it_is_out() -> None:
    """Robot 1 leaves cell 1 to the south; robot 0 comes into it from the west."""
    executor = executor_of((0, EAST), (1, SOUTH))
    executor.take(np.array([states((0, EAST), (1, SOUTH)), states((1, EAST), (7, SOUTH))]))
    assert letters(executor) == "WF"
    end(executor, False, True)
    assert letters(executor) == "FW"


def test_who_is_second_in_a_cell_waits_for_the_first_however_late() -> None:
    """Robot 0 comes through cell 8 first, robot 1 after it; robot 0 does not get on."""
    executor = executor_of((6, EAST), (2, SOUTH))
    executor.take(
        np.array(
            [
                states((6, EAST), (2, SOUTH)),
                states((7, EAST), (2, SOUTH)),
                states((8, EAST), (2, SOUTH)),
                states((9, EAST), (8, SOUTH)),
            ]
        )
    )
    assert [letters(executor) for _ in range(20)] == ["FW"] * 20
    for _ in range(2):
        end(executor, True, False)
        assert letters(executor) == "FW"
    end(executor, True, False)
    assert letters(executor) == "WF"


def test_what_is_kept_is_the_beginning_of_what_was_told() -> None:
    """Robots end their moves at random while plan after plan comes in: the League's rule for staged actions."""
    problem = random_problem(5, n_robots=14)
    graph = grid_lane_graph(problem.grid, "rotating")
    rng = np.random.default_rng(0)
    executor = PlanExecutor(graph, graph.state_index[problem.start_cell, EAST], 3)
    told: list[list[int]] = [[int(cell)] for cell in problem.start_cell]
    dropped = 0
    for seed in range(12):
        rows = plan(graph, executor.tail_states(), seed)
        executor.take(rows)
        ptr, cells = executor.cells_ahead()
        for robot, own in enumerate(told):
            expected = own + graph.state_cell[rows[1:, robot]].tolist()
            kept = cells[ptr[robot] : ptr[robot + 1]].tolist()
            distinct = [a for k, a in enumerate(kept) if k == 0 or a != kept[k - 1]]
            wanted = [a for k, a in enumerate(expected) if k == 0 or a != expected[k - 1]]
            assert distinct == wanted[: len(distinct)]
            dropped += len(wanted) - len(distinct)
        for _ in range(6):
            acting = executor.actions() != WAIT
            executor.ended(acting & (rng.random(len(told)) < 0.4))
        ptr, cells = executor.cells_ahead()
        told = [cells[ptr[robot] : ptr[robot + 1]].tolist() for robot in range(len(told))]
    assert dropped > 0


def plan(graph: LaneGraph, starts: np.ndarray, seed: int) -> np.ndarray:
    """Five timesteps to goals anywhere, without closed rings."""
    n = len(starts)
    rng = np.random.default_rng(seed)
    return (
        MultiStepPibt(seed=seed)
        .plan(
            Instance(
                graph=graph,
                starts=starts,
                goals=rng.permutation(graph.n_states)[:n].astype(np.int32),
                priorities=np.zeros(n),
                stay=np.zeros(n, dtype=np.bool_),
                fixed=np.zeros(n, dtype=np.bool_),
                blocked=np.zeros(graph.n_cells, dtype=np.bool_),
                allow_rotation=False,
                horizon=5,
            )
        )
        .states
    )


def test_a_drive_is_an_action_of_its_own_for_each_cell() -> None:
    executor = executor_of((0, EAST))
    executor.take(np.array([states((cell, EAST)) for cell in range(4)]))
    for _ in range(3):
        assert executor.actions().tolist() == [FORWARD]
        end(executor, True)
    assert executor.actions().tolist() == [WAIT]
