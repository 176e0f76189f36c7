"""MultiStepController: plays by the rules, finishes more than the plain controller, and copes with what is odd."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fleet.errors import FleetError
from fleet.league import multi_step_controller
from fleet.league.arena import Arena
from fleet.league.controller import PibtController
from fleet.league.multi_step_controller import METHODS, Method, MultiStepController, MultiStepControllerConfig
from fleet.league.play import Played, play
from fleet.league.rehearsal import problem_to_rehearse
from maps.formats.lorr import LeagueProblem, write_result
from maps.lane_graph import LaneGraph
from planners.mapf.arrays import IntArray
from planners.mapf.multi_step import goal_costs
from planners.mapf.multi_step.guidance import Errands, GuidanceConfig
from planners.mapf.multi_step.multi_step_pibt import Mover
from tests.unit.fleet.league.problems import CORRIDOR, ROOM, problem_of, random_problem, write_files
from tests.unit.fleet.league.replay import Replay

SHORT = GuidanceConfig(rounds=2, timesteps=60)
PATIENT_S = 60.0
"""A budget that is never short, so that the number of rounds decides and not the machine."""
STAIRS = ["..@@@@", "@..@@@", "@@..@@", "@@@..@", "@@@@..", "@@@@@."]
"""No row and no column is a street."""


def made(*, seed: int = 0, **settings: Any) -> MultiStepController:
    few = {"guidance": SHORT, "rehearsal_timesteps": 20}
    return MultiStepController(MultiStepControllerConfig(**(few | settings)), seed=seed)


def played_well(
    folder: Path,
    problem: LeagueProblem,
    controller: MultiStepController,
    steps: int,
    *,
    edition: int = 2024,
    budget_s: float = PATIENT_S,
) -> Played:
    """Play, and let the independent replay judge the file."""
    played = play(problem, controller, steps, budget_s)
    write_result(folder / "out.json", played.result)
    replay = Replay(write_files(folder, problem, edition=edition), folder / "out.json")
    assert replay.complaints == []
    assert replay.n_finished == played.result.n_finished
    assert (played.conflicts, played.result.planner_errors, played.result.schedule_errors) == ((), (), ())
    return played


def test_it_finishes_more_than_the_plain_controller(tmp_path: Path) -> None:
    finished, plain = 0, 0
    for seed in range(3):
        problem = random_problem(seed, n_robots=24)
        finished += played_well(tmp_path, problem, made(seed=seed), 150).result.n_finished
        plain += play(problem, PibtController(seed=seed), 150, PATIENT_S).result.n_finished
    assert finished > 1.1 * plain


@pytest.mark.parametrize("length", [1, 3, 5])
def test_operations_of_any_length_are_legal(tmp_path: Path, length: int) -> None:
    assert played_well(tmp_path, random_problem(3), made(length=length), 60).result.n_finished > 5


@pytest.mark.parametrize("budget_s", [0.02, PATIENT_S], ids=["hasty", "patient"])
def test_a_floor_too_large_for_exact_costs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, budget_s: float) -> None:
    monkeypatch.setattr(goal_costs, "EXACT_BYTES", 0)
    assert played_well(tmp_path, random_problem(4), made(), 100, budget_s=budget_s).result.n_finished > 20


@pytest.mark.parametrize(
    ("problem", "budget_s", "length"),
    [
        (problem_of(ROOM, [14], [[20], [14]]), 0.02, 3),
        (problem_of(ROOM, [14], [[20], [14]]), PATIENT_S, 5),
        (problem_of(STAIRS, [0], [[29], [0]]), PATIENT_S, 4),
    ],
    ids=["hasty", "patient", "patient in a cave"],
)
def test_on_a_large_floor_robots_look_farther_where_a_step_may_take_long(
    monkeypatch: pytest.MonkeyPatch, problem: LeagueProblem, budget_s: float, length: int
) -> None:
    monkeypatch.setattr(goal_costs, "EXACT_BYTES", 0)
    lengths = []

    class Noted(Mover):
        def __init__(self, *args: Any, length: int, **settings: Any) -> None:
            lengths.append(length)
            super().__init__(*args, length=length, **settings)

    monkeypatch.setattr(multi_step_controller, "Mover", Noted)
    made().prepare(Arena(problem), budget_s)
    assert lengths == [length]


def test_a_robot_that_has_only_a_turn_to_make_makes_it_without_exact_costs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """To turn costs as much as to wait for it; who waits must turn all the same, or it waits for ever."""
    monkeypatch.setattr(goal_costs, "EXACT_BYTES", 0)
    played = played_well(tmp_path, problem_of(ROOM, [14], [[20], [14]]), made(), 20)
    assert played.result.n_finished >= 4


def test_a_problem_of_2023_hands_its_tasks_out(tmp_path: Path) -> None:
    problem = random_problem(0, round_robin=True)
    played = played_well(tmp_path, problem, made(), 100, edition=2023)
    assert played.result.n_finished > play(problem, PibtController(), 100, PATIENT_S).result.n_finished


def test_one_robot_goes_the_shortest_way(tmp_path: Path) -> None:
    """East four, a turn, south two, a turn, west four; then the task begins anew."""
    played = played_well(tmp_path, problem_of(CORRIDOR, [0], [[4, 10]]), made(), 12)
    assert played.result.n_finished == 1
    assert "".join("WFRCT"[action] for action in played.result.actual[:, 0]) == "FFFFRFFRFFFF"


def test_robots_without_a_task_make_room(tmp_path: Path) -> None:
    """Ten robots, one task at a time, on a floor with hardly room to pass."""
    problem = problem_of(ROOM[:2], list(range(10)), [[11], [0]], pool_size=1)
    assert played_well(tmp_path, problem, made(), 80).result.n_finished >= 4


def test_who_is_in_a_dead_end_gets_out_before_others_get_in(monkeypatch: pytest.MonkeyPatch) -> None:
    """The outer robot wants to where the inner one stands, and to make room costs it more than the inner one gains."""

    def dear_to_enter(graph: LaneGraph, *_: object, **__: object) -> IntArray:
        west = graph.state_cell[graph.move_to] == graph.state_cell[graph.move_from] - 1
        return np.where(west, 56, 8).astype(np.int32)

    monkeypatch.setattr(multi_step_controller, "learn_guidance", dear_to_enter)
    floor = ["@@@@.....", ".........", "@@@@.....", "@@@@....."]
    problem = problem_of(floor, [9, 10], [[35], [9], [34], [13]], pool_size=2, round_robin=True)
    pushing = made(rehearsal_timesteps=0)
    assert play(problem, pushing, 150, PATIENT_S).result.n_finished > 10


@pytest.mark.parametrize("method", METHODS)
def test_every_method_is_legal_and_gets_on(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, method: Method) -> None:
    problem = random_problem(8, n_robots=12)
    plain = play(problem, PibtController(), 100, PATIENT_S).result.n_finished
    monkeypatch.setattr(multi_step_controller, "METHODS", (method,))
    assert played_well(tmp_path, problem, made(), 100).result.n_finished > plain


def test_what_does_most_in_a_rehearsal_is_done(monkeypatch: pytest.MonkeyPatch) -> None:
    """Guidance that leads astray, along the wall on the other side of the floor, is seen through."""

    def astray(graph: LaneGraph, *_: object, **__: object) -> IntArray:
        elsewhere = (graph.state_cell[graph.move_from] < 100) & (graph.state_cell[graph.move_to] < 100)
        drive = graph.state_cell[graph.move_from] != graph.state_cell[graph.move_to]
        return np.where(elsewhere & drive, 400, 8).astype(np.int32)

    monkeypatch.setattr(multi_step_controller, "learn_guidance", astray)
    problem = problem_of(["." * 20] * 6, [0], [[19, 0]])
    led_astray = play(problem, made(rehearsal_timesteps=0), 600, PATIENT_S).result.n_finished
    straight = play(problem, made(rehearsal_timesteps=60), 600, PATIENT_S).result.n_finished
    assert straight == 600 // (19 + 2 + 19 + 2)
    assert led_astray <= 10


def test_a_rehearsal_knows_what_is_known_at_the_start() -> None:
    problem = problem_of(ROOM, [3, 4], [[0, 1], [2], [30, 31], [35]], pool_size=3)
    arena = Arena(problem)
    known = Errands(ptr=np.array([0, 2, 3, 5], dtype=np.int32), cell=np.array([0, 1, 2, 30, 31], dtype=np.int32))
    rehearsal = problem_to_rehearse(arena, known)
    assert rehearsal.start_cell.tolist() == [3, 4]
    assert [rehearsal.errands(task).tolist() for task in range(4)] == [[0, 1], [2], [30, 31], [0, 1]]


def test_a_full_floor(tmp_path: Path) -> None:
    """All but one cell taken."""
    problem = problem_of(ROOM[:4], list(range(23)), [[cell] for cell in range(24)])
    assert played_well(tmp_path, problem, made(), 60).result.n_finished > 10


def test_a_floor_of_one_cell(tmp_path: Path) -> None:
    assert played_well(tmp_path, problem_of(["."], [0], [[0]]), made(), 3).result.n_finished == 3


def test_a_goal_out_of_reach_stops_nobody_else(tmp_path: Path) -> None:
    problem = problem_of(["....@.", "....@."], [0, 7], [[5], [2], [8], [1]])
    assert played_well(tmp_path, problem, made(), 40).result.n_finished >= 2


def test_a_tiny_budget_is_late_and_legal() -> None:
    played = play(random_problem(5), made(), 30, 1e-9)
    assert played.late_steps == 30
    assert (played.conflicts, played.result.planner_errors, played.result.schedule_errors) == ((), (), ())
    assert played.result.n_finished > 0


def test_no_time_for_preparations_is_legal_too() -> None:
    played = play(random_problem(5), made(startup_s=1e-9), 30, PATIENT_S)
    assert played.conflicts == ()
    assert played.result.n_finished > 0


def test_the_same_seed_plays_the_same() -> None:
    runs = [play(random_problem(6), made(seed=seed), 40, PATIENT_S).result for seed in (7, 7, 8)]
    assert (runs[0].actual == runs[1].actual).all()
    assert (runs[0].schedule == runs[1].schedule).all()
    assert (runs[0].actual != runs[2].actual).any()


def test_it_changes_nothing_in_the_arena() -> None:
    arena = Arena(random_problem(7))
    controller = made()
    before = [arena.states.copy(), arena.task_of.copy(), arena.errand_of.copy(), arena.errand_cell.copy()]
    controller.prepare(arena, PATIENT_S)
    controller.step(arena)
    for array, kept in zip((arena.states, arena.task_of, arena.errand_of, arena.errand_cell), before, strict=True):
        np.testing.assert_array_equal(array, kept)


@pytest.mark.parametrize("value", [0.0, 1.5, float("nan")])
def test_settings_that_make_no_sense_are_refused(value: float) -> None:
    with pytest.raises(FleetError, match=f"multi_step_pibt: budget_share = {value}; valid: 0 < budget_share <= 1"):
        MultiStepControllerConfig(budget_share=value)


def test_a_rehearsal_of_less_than_nothing_is_refused() -> None:
    with pytest.raises(FleetError, match="multi_step_pibt: rehearsal_timesteps = -1; valid: an integer >= 0"):
        MultiStepControllerConfig(rehearsal_timesteps=-1)
