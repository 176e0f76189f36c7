"""Learned PIBT: whatever the weights say, plans are legal; weights for other observations are refused."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from benchmarks.mapf.learned.learned_pibt import LearnedPibt, LearnedPibtConfig
from benchmarks.mapf.learned.learned_stepper import LearnedStepper, Moment
from benchmarks.mapf.learned.observation import N_CELLS, N_MOVES, N_SEEN, ONE, RADIUS
from benchmarks.mapf.learned.scores import Scores, WeightsError, read_scores, write_scores
from maps.grid import GridMap
from maps.lane_graph import grid_lane_graph
from planners.errors import PlanningError
from planners.mapf.distance_table import DistanceTable
from planners.mapf.multi_step.stagnation import Stagnation
from planners.mapf.problem import Plan
from planners.mapf.validate import conflicts
from tests.unit.planners.mapf.lanes import instance_of, open_grid, rotating_grid

MIDDLE = RADIUS * (2 * RADIUS + 1) + RADIUS
AHEAD = MIDDLE - (2 * RADIUS + 1)


def weights(rng: np.random.Generator | None = None) -> Scores:
    """Weights drawn at random; without a generator all moves are as good."""

    def drawn(*shape: int) -> Any:
        return (np.zeros(shape) if rng is None else rng.normal(size=shape)).astype(np.float32)

    return Scores(drawn(N_SEEN, 8), drawn(8), drawn(8, 8), drawn(8), drawn(8, N_MOVES), drawn(N_MOVES))


def planner(folder: Path, scores: Scores, *, seed: int = 0, **settings: Any) -> LearnedPibt:
    path = folder / "weights.npz"
    write_scores(path, scores)
    return LearnedPibt(LearnedPibtConfig(weights=str(path), **settings), seed=seed)


def moment(stepper: LearnedStepper, goals: list[int], **other: Any) -> Moment:
    graph, n = stepper.graph, len(goals)
    distances, row = DistanceTable(graph, np.zeros(graph.n_cells, dtype=np.bool_)).rows(np.array(goals, np.int32))
    given: dict[str, Any] = {
        "distances": distances,
        "row": row,
        "order": np.arange(n, dtype=np.int32),
        "waited": np.zeros(n, dtype=np.int32),
        "locked": np.zeros(n, dtype=np.bool_),
        "unit": 1,
        "patience": 30,
        "eagerness": 0.0,
        "allow_rotation": True,
    }
    return Moment(**{**given, **other})


@pytest.mark.parametrize("allow_rotation", [False, True])
def test_plans_are_legal_whatever_the_weights_say(tmp_path: Path, allow_rotation: bool) -> None:
    for seed, share in enumerate((0.1, 0.4, 0.9)):
        rng = np.random.default_rng(seed)
        graph = grid_lane_graph(GridMap(rng.random((7, 9)) > 0.25), "pebble")
        n = int(share * graph.n_states)
        starts, goals = rng.permutation(graph.n_states)[:n], rng.integers(-1, graph.n_states, size=n)
        fixed = rng.random(n) < 0.1
        instance = instance_of(
            graph, starts.tolist(), goals.tolist(), fixed=fixed.tolist(), horizon=20, allow_rotation=allow_rotation
        )
        plan = planner(tmp_path, weights(rng), patience=5).plan(instance)
        assert not conflicts(graph, plan, allow_rotation=allow_rotation)
        assert (plan.states[:, fixed] == starts[fixed]).all()
        assert (plan.states[1:] != plan.states[:-1]).any()


def test_the_same_seed_gives_the_same_plan(tmp_path: Path) -> None:
    instance = instance_of(open_grid(5, 5), list(range(10)), list(range(24, 14, -1)), horizon=12)

    def drive(seed: int) -> Plan:
        return planner(tmp_path, weights(), seed=seed).plan(instance)

    assert np.array_equal(drive(1).states, drive(1).states)
    assert not np.array_equal(drive(1).states, drive(2).states)


def test_weights_are_kept_to_the_bit(tmp_path: Path) -> None:
    scores = weights(np.random.default_rng(0))
    write_scores(tmp_path / "a.npz", scores)
    assert all(np.array_equal(a, b) for a, b in zip(read_scores(tmp_path / "a.npz"), scores, strict=True))


def test_weights_for_other_observations_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "other.npz"
    np.savez(path, observation=np.array([0, RADIUS, N_SEEN]), **weights()._asdict())
    with pytest.raises(WeightsError, match="weights are for the observation"):
        read_scores(path)
    write_scores(path, weights()._replace(first=np.zeros((N_SEEN + 1, 8), dtype=np.float32)))
    with pytest.raises(WeightsError, match="first has shape"):
        LearnedPibt(LearnedPibtConfig(weights=str(path)))


@pytest.mark.parametrize("content", [None, b"", b"no archive"])
def test_files_that_are_no_weights_are_refused(tmp_path: Path, content: bytes | None) -> None:
    path = tmp_path / "bad.npz"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(WeightsError, match=r"bad\.npz: cannot be read as weights"):
        read_scores(path)


def test_graphs_with_headings_are_refused(tmp_path: Path) -> None:
    with pytest.raises(PlanningError, match="valid: 'pebble'"):
        planner(tmp_path, weights()).plan(instance_of(rotating_grid(3, 3), [0], [1]))


@pytest.mark.parametrize(
    ("settings", "said"),
    [
        ({"patience": -1}, "patience = -1; valid: an integer >= 0"),
        ({"eagerness": float("nan")}, "eagerness = nan; valid: a finite number"),
        ({"impatience": -1.0}, "impatience = -1.0; valid: a number >= 0"),
    ],
)
def test_settings_out_of_range_are_refused(settings: dict[str, Any], said: str) -> None:
    with pytest.raises(PlanningError, match=said):
        LearnedPibtConfig(**settings)


def test_what_is_seen_turns_with_the_way_to_the_goal() -> None:
    """An agent in the middle of an open floor sees the same whichever way it has to go."""
    graph = open_grid(9, 9)
    stepper = LearnedStepper(graph, np.zeros(81, dtype=np.bool_), 1, weights())
    now = np.array([40], dtype=np.int32)
    seen = [stepper.observe_along(now, now, moment(stepper, [goal])).copy() for goal in (37, 43, 13, 67)]
    assert all(np.array_equal(one, seen[0]) for one in seen)
    assert seen[0][0, AHEAD] == -ONE


def test_later_ones_see_where_earlier_ones_go() -> None:
    graph = open_grid(1, 5)
    stepper = LearnedStepper(graph, np.zeros(5, dtype=np.bool_), 2, weights())
    now, after = np.array([1, 2], dtype=np.int32), np.array([1, 3], dtype=np.int32)
    asked = moment(stepper, [4, 0])
    forward, decided = 2 * N_CELLS + AHEAD, 4 * N_CELLS + AHEAD
    second_first = stepper.observe_along(now, after, asked._replace(order=np.array([1, 0], dtype=np.int32))).copy()
    assert second_first[0, decided] == ONE
    assert second_first[0, forward] == ONE  # it goes on ahead
    first_first = stepper.observe_along(now, after, asked).copy()
    assert first_first[0, decided] == -ONE
    assert first_first[0, forward] == -ONE  # it wishes to come towards it


def test_whoever_has_waited_for_long_goes_by_distances() -> None:
    """With weights that would rather wait."""
    lazy = weights()
    lazy.last_bias[-1] = 10.0
    graph = open_grid(1, 5)
    stepper = LearnedStepper(graph, np.zeros(5, dtype=np.bool_), 1, lazy)
    now, after = np.array([1], dtype=np.int32), np.empty(1, dtype=np.int32)
    for waited, to in ((29, 1), (30, 2)):
        stepper.step(now, after, moment(stepper, [4], waited=np.array([waited], dtype=np.int32)))
        assert after[0] == to


def test_progress_counts_from_the_nearest_so_far() -> None:
    progress = Stagnation(1)
    goal, other = np.array([7], dtype=np.int32), np.array([8], dtype=np.int32)

    def seen(left: int, to: Any) -> int:
        return int(progress.look(np.array([left], dtype=np.int32), to)[0])

    assert [seen(left, goal) for left in (5, 4, 5, 4, 3)] == [0, 0, 1, 2, 0]
    assert [seen(9, other), seen(9, other)] == [0, 1]
