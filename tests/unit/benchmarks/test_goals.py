"""Goals: what was learned is judged by all seeds' episodes, by parcels and not by pay."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path

import pytest

from benchmarks.training.goals import Gap, Mean, Saved, Success, TimesScript
from benchmarks.training.lessons import LESSONS
from fleet.training.evaluation import play
from fleet.training.intervals import share
from fleet.training.recipes import RECIPES
from fleet.training.results import write_episodes


def seeds_of(folder: Path, *evaluations: Mapping[str, Sequence[Mapping[str, float]]]) -> list[Path]:
    """Write the episodes of an evaluation for each seed of a training; returns their folders."""
    out = []
    for k, scores in enumerate(evaluations):
        out.append(folder / str(k))
        out[-1].mkdir()
        write_episodes(out[-1], {name: list(map(dict, rows)) for name, rows in scores.items()}, range(2))
    return out


def test_successes_are_counted_of_the_trials_of_all_seeds(tmp_path: Path) -> None:
    rows = [{"loaded": 1.0, "delivered": 1.0, "parcels": 2.0}, {"loaded": 0.0, "delivered": 1.0, "parcels": 2.0}]
    folders = seeds_of(tmp_path, {"learned": rows}, {"learned": rows})
    goal = Success(figures=("loaded", "delivered"), of="parcels", target=">= 0.9")
    assert goal.successes(folders) == {"learned": (6, 8)}
    row = goal.row(folders)
    assert (row.unit[-6:], row.value) == ("6 of 8", share(6, 8).low)
    assert Success(figures=("delivered",), target=">= 0.9").successes(folders) == {"learned": (4, 4)}


def test_the_worse_end_of_a_multiple_counts(tmp_path: Path) -> None:
    def scores(learned: float) -> dict[str, list[dict[str, float]]]:
        return {"learned": [{"x": learned}] * 2, "scripted": [{"x": 10.0}] * 2}

    folders = seeds_of(tmp_path, scores(11.0), scores(13.0))
    assert TimesScript(figure="x", target=">= 1").row(folders).value < 1.1
    assert TimesScript(figure="x", target="<= 1").row(folders).value > 1.3
    assert TimesScript(figure="x", target=">= 1").row(folders[:1]).value == pytest.approx(1.1)
    assert Mean(figure="x", target=">= 1").row(folders).value == pytest.approx(12.0)


def test_what_is_saved_is_counted_each_time(tmp_path: Path) -> None:
    learned = [{"took": 8.0, "n": 4.0}, {"took": 16.0, "n": 4.0}]
    folders = seeds_of(tmp_path, {"learned": learned, "scripted": [{"took": 10.0, "n": 2.0}] * 2})
    row = Saved(figure="took", count="n", slack=4.0, target=">= 0.5").row(folders)
    assert row.value == pytest.approx(0.5)
    assert row.unit.endswith("5.00 to 3.00")


def test_the_gap_is_from_the_best_rule_to_the_oracle(tmp_path: Path) -> None:
    late = {"learned": 6.0, "scripted": 9.0, "hungarian": 8.0, "rollout": 4.0}
    (folder,) = seeds_of(tmp_path, {name: [{"late": x}] * 2 for name, x in late.items()})
    row = Gap(figure="late", target=">= 0.5").row([folder])
    assert row.value == pytest.approx(0.5)
    assert "from hungarian to rollout" in row.unit
    late["learned"] = 4.0
    more = {name: [{"late": x}, {"late": x + (name == "learned")}] for name, x in late.items()}
    write_episodes(folder, {name: list(map(dict, rows)) for name, rows in more.items()}, range(2))
    row = Gap(figure="late", target=">= 0.5").row([folder])
    assert row.value == pytest.approx(0.75), "the worse of both episodes, as a resample may have it twice"
    assert "mean 0.88" in row.unit
    write_episodes(folder, {name: [{"late": 4.0}] for name in late}, [0])
    assert math.isnan(Gap(figure="late", target=">= 0.5").row([folder]).value)


@pytest.mark.parametrize(("recipe", "figures"), [("transfer", {"parcels": 2.0}), ("cell", {"deliveries": 2.0})])
def test_parcels_are_counted_once(recipe: str, figures: dict[str, float]) -> None:
    """The script moves both parcels of an episode; in `cell`, car and arm are both paid for each."""
    found = RECIPES[recipe]
    env = found.make(**found.arguments)
    score = play(env, found.scripted(), 2, found.figures, found.at_end)
    env.close()
    assert {name: score[name] for name in figures} == figures
    assert score["loaded"] + score["delivered"] == (2.0 if recipe == "transfer" else 8.0)


def test_every_column_of_a_lesson_is_one_of_its_recipe() -> None:
    for recipe, lesson in LESSONS.items():
        known = {*RECIPES[recipe].figures, *RECIPES[recipe].at_end}
        goals = [goal for place in (lesson, *lesson.places.values()) for goal in place.goals]
        wanted = {lesson.figure}
        for goal in goals:
            wanted |= {*goal.figures, goal.of or lesson.figure} if isinstance(goal, Success) else {goal.figure}
            wanted |= {goal.count} if isinstance(goal, Saved) else set()
        assert wanted <= known, recipe
