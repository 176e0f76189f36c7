"""POGEMA's episodes are drawn by its rules, and what is played on them is counted and judged."""

from __future__ import annotations

from itertools import islice
from pathlib import Path

import numpy as np
import pytest

from benchmarks.harness import Trial
from benchmarks.mapf import instances
from benchmarks.mapf.pogema import measure_cell, measure_pogema
from benchmarks.mapf.pogema.episode import Episode, Floor, read_floors
from benchmarks.mapf.pogema.play import play
from benchmarks.mapf.pogema.scores import STAGES, read_scores
from maps.lane_graph import grid_lane_graph
from planners.mapf.arrays import IntArray

PLAIN = Floor("plain", ("...#.", "..##.", "...#.", "####."))
"""Nine free cells on the left, four on the right."""
MARKED = Floor("marked", ("$$.@@", "$#.#@", "!...."))


def first(episode: Episode, count: int) -> list[list[int]]:
    return [list(islice(episode.goals(agent), count)) for agent in range(episode.n)]


def test_agents_stay_in_their_part_of_the_floor_and_no_start_or_first_goal_is_taken_twice() -> None:
    for seed in range(20):
        episode = Episode(PLAIN, 6, seed=seed)
        goals = np.array(first(episode, 30))
        parts = PLAIN.parts
        assert (parts[goals] == parts[episode.starts][:, None]).all()
        taken = [*episode.starts.tolist(), *goals[:, 0].tolist()]
        assert len(set(taken)) == 12
        assert PLAIN.grid.free.ravel()[taken].all()


def test_in_each_part_starts_and_goals_take_turns_in_the_order_of_the_shuffled_cells() -> None:
    seed = 3
    order = [(row, col) for row in range(4) for col in range(5) if PLAIN.lines[row][col] == "."]
    np.random.default_rng(seed).shuffle(order)
    cells = [row * 5 + col for row, col in order]
    left, right = ([cell for cell in cells if (cell % 5 < 4) == is_left] for is_left in (True, False))
    episode = Episode(PLAIN, 6, seed=seed)
    pairs = dict(zip(episode.starts.tolist(), (goals[0] for goals in first(episode, 1)), strict=True))
    assert pairs == dict(zip(left[:-1:2] + right[::2], left[1::2] + right[1::2], strict=True))
    assert episode.starts.tolist() == sorted(pairs, key=cells.index)


def test_the_streams_are_those_of_one_generator_for_each_agent() -> None:
    seeds = np.random.default_rng(7).integers(np.iinfo(np.int32).max, size=3)
    episode = Episode(PLAIN, 3, seed=7)
    parts = PLAIN.parts
    for agent, goals in enumerate(first(episode, 12)):
        rng = np.random.default_rng(seeds[agent])
        part = [divmod(int(cell), 5) for cell in np.flatnonzero(parts == parts[goals[0]])]
        drawn = [tuple(rng.choice(part, 1)[0]) for _ in range(11)]
        assert [divmod(cell, 5) for cell in goals[1:]] == drawn


def test_marks_say_where_agents_start_and_go() -> None:
    starts, goals = {0, 1, 5, 10}, {3, 4, 9, 10}
    episode = Episode(MARKED, 4, seed=1)
    assert set(episode.starts.tolist()) == starts
    firsts = [stream[0] for stream in first(episode, 1)]
    assert set(firsts) == goals
    assert {cell for stream in first(episode, 50) for cell in stream} == goals
    assert (Episode(MARKED, 2, seed=1).starts == episode.starts[:2]).all()


def test_the_seed_decides() -> None:
    assert first(Episode(PLAIN, 4, seed=5), 9) == first(Episode(PLAIN, 4, seed=5), 9)
    assert first(Episode(PLAIN, 4, seed=5), 9) != first(Episode(PLAIN, 4, seed=6), 9)


def test_a_map_without_room_and_a_map_with_a_short_line_are_refused() -> None:
    with pytest.raises(ValueError, match="no room for 7 agents; valid: 1 to 6"):
        Episode(PLAIN, 7, seed=0)
    with pytest.raises(ValueError, match="different lengths"):
        Floor("torn", ("..", "."))


def test_maps_are_read_by_name_and_another_file_is_named(tmp_path: Path) -> None:
    path = tmp_path / "maps.yaml"
    path.write_text('"one": |-\n  ..#\n  ...\ntwo: |-\n  $@\n', encoding="utf-8")
    assert read_floors(path) == {"one": Floor("one", ("..#", "...")), "two": Floor("two", ("$@",))}
    path.write_text("one: [1, 2]\n", encoding="utf-8")
    with pytest.raises(ValueError, match="line 1"):
        read_floors(path)


class _Direct:
    """One agent on a row of cells goes straight to its goal."""

    def step(self, states: IntArray, goals: IntArray, next_goals: IntArray) -> IntArray:
        del next_goals
        return (states + np.sign(goals - states)).astype(np.int32)


def test_a_goal_counts_in_the_step_that_reaches_it_and_the_next_one_is_given_at_once() -> None:
    row = Floor("row", ("......",))
    episode = Episode(row, 1, seed=2)
    position, stream, finished = int(episode.starts[0]), episode.goals(0), []
    goal = next(stream)
    for _ in range(40):
        position += int(np.sign(goal - position))
        finished.append(int(position == goal))
        goal = next(stream) if position == goal else goal
    played = play(episode, grid_lane_graph(row.grid, "pebble"), _Direct(), steps=40)
    assert played.finished.tolist() == finished
    assert played.throughput == pytest.approx(sum(finished) / 40)


@pytest.fixture
def folder() -> Path:
    path = instances.INSTANCES / "pogema"
    if not path.is_dir():
        pytest.skip(f"no folder {path}")
    return path


def test_published_cells_are_there_and_an_episode_of_each_kind_is_played(folder: Path) -> None:
    trial = Trial(quick=True, seeds=(0,))
    for stage in STAGES:
        floors = read_floors(folder / stage.folder / "maps.yaml")
        for n in stage.sizes:
            scores = read_scores(folder / stage.folder / "RHCR.json", n)
            assert len(scores) == 128
            assert all((score * stage.steps).is_integer() for score in scores.values())
        if stage.name in ("random", "mazes"):
            n = stage.sizes[0]
            scores = read_scores(folder / stage.folder / "RHCR.json", n)
            episodes = list(scores)[::32]
            cell = measure_cell(trial, stage, n, floors, episodes)
            assert trial.failures == []
            assert np.mean(cell.throughput) >= 0.9 * np.mean([scores[episode] for episode in episodes])


def test_without_the_files_every_kind_is_left_out_with_a_reason(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(instances, "INSTANCES", tmp_path)
    trial = Trial(quick=True, seeds=(0,))
    assert list(measure_pogema(trial)) == []
    assert [note.split(",")[1] for note in trial.notes] == [f" {stage.name}: left out" for stage in STAGES]
