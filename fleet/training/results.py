"""Results: the files that a training run leaves behind."""

from __future__ import annotations

import csv
import dataclasses
import io
import json
import math
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import Any

from fleet.charts.curves import XyCurve, draw_curves
from fleet.recording import versions
from fleet.training.errors import TrainingError
from fleet.training.evaluation import AGENT_MINUTES, RETURN, Score
from fleet.training.intervals import difference, interval
from fleet.training.recipes import TrainingStage
from fleet.training.settings import TrainConfig
from fleet.whole_file import require_place, write_whole

CONFIG, PROGRESS, EPISODES, EVALUATION, PLOT, RECORDING = (
    "config.json",
    "progress.csv",
    "episodes.csv",
    "evaluation.json",
    "curve.png",
    "curves.rrd",
)
CHECKPOINT = "checkpoint.pt"
STEPS = "steps of agents"
"""What goes across in a curve of learning."""
LEARNED, SCRIPTED, RANDOM = "learned", "scripted", "random"
"""Names of the policies that are compared."""


def prepare_folder(folder: Path, *, resume: bool) -> None:
    """Make sure that a training run can write its files.

    Args:
        folder: Created with its parents if it does not exist.
        resume: Whether the files of an earlier run may be there.

    Raises:
        TrainingError: It cannot be used.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        require_place(folder / CONFIG)
    except OSError as error:
        raise TrainingError(f"--out {folder}: {error.strerror}; valid: a directory that can be written") from error
    if not resume and ((folder / PROGRESS).exists() or (folder / CHECKPOINT).exists()):
        raise TrainingError(f"--out {folder}: holds a training run; valid: --resume, or another directory")


def write_config(folder: Path, config: TrainConfig, stages: Sequence[TrainingStage]) -> None:
    """Write what decides the run, the stages of its recipe, and the versions it ran with."""
    content = {**dataclasses.asdict(config), "stages": list(map(dataclasses.asdict, stages)), "versions": versions()}
    write_whole(folder / CONFIG, json.dumps(content, indent=2) + "\n")


def write_progress(folder: Path, rows: Sequence[Mapping[str, float]]) -> None:
    """Write the table of all updates so far; what an interrupted run wrote after its last checkpoint goes."""
    write_whole(folder / PROGRESS, _lines(rows, head=True) if rows else "")


def append_progress(folder: Path, row: Mapping[str, float]) -> None:
    """Write an update at the end of the table, at once and as a whole line."""
    with (folder / PROGRESS).open("a", encoding="utf-8", newline="") as file:
        file.write(_lines([row], head=file.tell() == 0))


def draw_progress(folder: Path, rows: Sequence[Mapping[str, float]], figure: str) -> None:
    """Draw the curve of all updates."""
    found = [(row["steps"], row[figure]) for row in rows if not math.isnan(row[figure])]
    if found:
        curve = XyCurve(name=LEARNED, points=found)
        draw_curves(f"{figure} per episode while learning", STEPS, figure, [curve]).write_png(folder / PLOT)


def write_episodes(folder: Path, scores: Mapping[str, Sequence[Score]], seeds: Sequence[int]) -> None:
    """Write the scores of every policy in every episode; who was interrupted has played the first of the seeds."""
    text = io.StringIO()
    table = csv.writer(text, lineterminator="\n")
    names = list(next(iter(scores.values()))[0])
    table.writerow(["policy", "seed", *names])
    for policy, played in scores.items():
        for seed, score in zip(seeds[: len(played)], played, strict=True):
            table.writerow([policy, seed, *(f"{score[name]:.6g}" for name in names)])
    write_whole(folder / EPISODES, text.getvalue())


def findings(
    scores: Mapping[str, Sequence[Score]], figures: Sequence[str], *, shares: Collection[str] = ()
) -> dict[str, Any]:
    """Means by policy, and how far what was learned is from the others on the same episodes, with intervals.

    Args:
        scores: By policy, on the same episodes.
        figures: Names of those that are wanted; the return is among them always.
        shares: Those of them that are shares of episodes, as `Recipe.shares`.

    Returns:
        `episodes`; `policies` and `gain`: by policy and figure, the interval; `per_agent_minute`: by policy and figure,
        the sum over all episodes for each minute of each agent.
    """
    names = (*figures, RETURN)
    found: dict[str, Any] = {"episodes": len(scores[LEARNED]), "policies": {}, "gain": {}, "per_agent_minute": {}}
    for policy, played in scores.items():
        values = {name: [score[name] for score in played] for name in names}
        found["policies"][policy] = {
            name: dataclasses.asdict(interval(values[name], is_share=name in shares)) for name in names
        }
        minutes = sum(score[AGENT_MINUTES] for score in played)
        found["per_agent_minute"][policy] = {name: sum(values[name]) / minutes for name in names}
        if policy != LEARNED:
            found["gain"][policy] = {
                name: dataclasses.asdict(
                    difference([score[name] for score in scores[LEARNED]], values[name], is_share=name in shares)
                )
                for name in names
            }
    return found


def write_evaluation(folder: Path, found: Mapping[str, Any], *, cpu_s: float) -> None:
    """Write the findings, and what the learning took [s of the processor]."""
    write_whole(folder / EVALUATION, json.dumps({**found, "train_cpu_s": round(cpu_s, 1)}, indent=2) + "\n")


def _lines(rows: Sequence[Mapping[str, float]], *, head: bool) -> str:
    """Rows of the table of progress, below its head if that is wanted."""
    text = io.StringIO()
    table = csv.writer(text, lineterminator="\n")
    table.writerows([rows[0]] if head else [])
    table.writerows(map(_entry, row.values()) for row in rows)
    return text.getvalue()


def _entry(value: float) -> str:
    """A number of the table of progress: whole ones, such as steps, with all their digits."""
    if math.isnan(value):
        return ""
    return str(int(value)) if float(value).is_integer() else f"{value:.6g}"
