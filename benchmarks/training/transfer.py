"""Transfer: what was learned in one place, played in another on the same episodes beside the script."""

from __future__ import annotations

import csv
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.training.goals import Success, by_policy, read_episodes
from benchmarks.training.lessons import Place
from fleet.envs.policies import make_policy
from fleet.envs.policies.policy import Policy, Random
from fleet.training.evaluation import evaluate
from fleet.training.intervals import share
from fleet.training.recipes import RECIPES
from fleet.training.results import (
    CONFIG,
    EVALUATION,
    LEARNED,
    RANDOM,
    SCRIPTED,
    findings,
    write_episodes,
    write_evaluation,
)


def play_transfer(recipe: str, out: Path, name: str, place: Place) -> Path:
    """Play a trained seed somewhere else, unless that was done before.

    Args:
        recipe: What it was trained by.
        out: Folder of the training run.
        name: Of the place.
        place: Where it is played.

    Returns:
        Folder with the episodes and the findings.
    """
    folder = out / name.replace(", ", "_").replace(" ", "_")
    if (folder / EVALUATION).exists():
        return folder
    # PyTorch is an extra.
    from fleet.training.ppo.policy import load_policy

    folder.mkdir(exist_ok=True)
    config = json.loads((out / CONFIG).read_text(encoding="utf-8"))
    found, seed = RECIPES[recipe], config["seed"]
    policies: dict[str, Policy] = {LEARNED: load_policy(out), SCRIPTED: found.scripted()}
    for other in place.policies:
        policies[other] = Random(seed) if other == RANDOM else make_policy("dispatch", other, seed)
    seeds = [int(row["seed"]) for row in read_episodes(out) if row["policy"] == LEARNED][: place.n_episodes]
    scores = evaluate(found, {**config["arguments"], **place.arguments}, policies, seeds)
    write_episodes(folder, scores, seeds)
    spent_s = json.loads((out / EVALUATION).read_text(encoding="utf-8"))["train_cpu_s"]
    write_evaluation(folder, findings(scores, (*found.figures, *found.at_end), shares=found.shares), cpu_s=spent_s)
    return folder


def write_places(path: Path, places: Mapping[str, Sequence[Path]]) -> None:
    """Write what everybody came to in every place, as means over all seeds' episodes.

    Args:
        path: A CSV file.
        places: Evaluations, one for each seed of the training, by the name of the place.
    """
    with path.open("w", encoding="utf-8", newline="") as file:
        table: Any = csv.writer(file, lineterminator="\n")
        for place, folders in places.items():
            played = by_policy(folders)
            figures = [name for name in next(iter(played.values()))[0] if name not in ("policy", "seed")]
            if not file.tell():
                table.writerow(["place", "policy", "episodes", *figures])
            for policy, rows in played.items():
                means = (np.mean([float(row[name]) for row in rows]) for name in figures)
                table.writerow([place, policy, len(rows), *(f"{mean:.4g}" for mean in means)])


def write_shares(path: Path, folders: Mapping[tuple[str, str], Sequence[Path]], success: Success) -> None:
    """Write the share of successes with its interval as a table.

    Args:
        path: A CSV file.
        folders: Evaluations, by what was trained (a seed, or all) and the fidelity it was played at.
        success: What counts successes.
    """
    with path.open("w", encoding="utf-8", newline="") as file:
        table: Any = csv.writer(file, lineterminator="\n")
        trials = "episodes" if success.of is None else success.of
        table.writerow(["trained_from", "fidelity", "policy", trials, "success", "low", "high"])
        for (trained, fidelity), played in folders.items():
            for policy, (won, n) in success.successes(played).items():
                found = share(won, n)
                figures = (found.mean, found.low, found.high)
                table.writerow([trained, fidelity, policy, n, *(f"{x:.4f}" for x in figures)])
