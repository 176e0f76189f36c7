"""Transfer: what was learned in one place, played in another on the same episodes beside the script."""

from __future__ import annotations

import csv
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from fleet.envs.policies.policy import Random
from fleet.training.evaluation import evaluate
from fleet.training.intervals import share
from fleet.training.recipes import RECIPES
from fleet.training.results import (
    CONFIG,
    EPISODES,
    EVALUATION,
    LEARNED,
    RANDOM,
    SCRIPTED,
    findings,
    write_episodes,
    write_evaluation,
)

TRANSFERS: dict[str, dict[str, dict[str, Any]]] = {
    "reach": {"physics": {"fidelity": "physics"}},
    "navigate": {
        "physics": {"fidelity": "physics"},
        "another site, physics": {"site": "medium", "n_cars": 8, "fidelity": "physics"},
        "another team, physics": {"n_cars": 12, "fidelity": "physics"},
    },
}
"""Where what was learned is played as well, by recipe and name: arguments of the environment."""
SHARES = ("reach",)
"""Recipes of success or failure."""
N_PHYSICAL = 20
"""Episodes at most: one of `navigate` takes seconds in physics."""


def play_transfer(recipe: str, out: Path, where: str) -> Path:
    """Play a trained seed somewhere else, unless that was done before.

    Args:
        recipe: A key of `TRANSFERS`.
        out: Folder of the training run.
        where: A key of `TRANSFERS[recipe]`.

    Returns:
        Folder with the episodes and the findings.
    """
    # PyTorch is an extra.
    from fleet.training.ppo.policy import load_policy

    folder = out / where.replace(", ", "_").replace(" ", "_")
    if (folder / EVALUATION).exists():
        return folder
    folder.mkdir(exist_ok=True)
    config = json.loads((out / CONFIG).read_text(encoding="utf-8"))
    found = RECIPES[recipe]
    policies = {LEARNED: load_policy(out), SCRIPTED: found.scripted()}
    if recipe in SHARES:
        policies[RANDOM] = Random(config["seed"])
    seeds = [int(row["seed"]) for row in read_episodes(out) if row["policy"] == LEARNED]
    if recipe not in SHARES:
        seeds = seeds[:N_PHYSICAL]
    scores = evaluate(found, {**config["arguments"], **TRANSFERS[recipe][where]}, policies, seeds)
    write_episodes(folder, scores, seeds)
    spent_s = json.loads((out / EVALUATION).read_text(encoding="utf-8"))["train_cpu_s"]
    write_evaluation(folder, findings(scores, found.figures), cpu_s=spent_s)
    return folder


def read_episodes(folder: Path) -> list[dict[str, str]]:
    """Scores of all policies in all episodes of an evaluation."""
    with (folder / EPISODES).open(encoding="utf-8", newline="") as table:
        return list(csv.DictReader(table))


def successes(folders: Sequence[Path], figure: str) -> dict[str, tuple[int, int]]:
    """Episodes that succeeded and all episodes, by policy, of some evaluations taken together."""
    found: dict[str, tuple[int, int]] = {}
    for row in (row for folder in folders for row in read_episodes(folder)):
        won, played = found.get(row["policy"], (0, 0))
        found[row["policy"]] = (won + round(float(row[figure])), played + 1)
    return found


def write_shares(path: Path, folders: Mapping[tuple[str, str], Sequence[Path]], figure: str) -> None:
    """Write the share of successes with its interval as a table.

    Args:
        path: A CSV file.
        folders: Evaluations, by what was trained (a seed, or all) and the fidelity it was played at.
        figure: 1 in an episode that succeeded, 0 in any other.
    """
    with path.open("w", encoding="utf-8", newline="") as file:
        table: Any = csv.writer(file, lineterminator="\n")
        table.writerow(["trained_from", "fidelity", "policy", "episodes", "success", "low", "high"])
        for (trained, fidelity), played in folders.items():
            for policy, (won, n) in successes(played, figure).items():
                found = share(won, n)
                figures = (found.mean, found.low, found.high)
                table.writerow([trained, fidelity, policy, n, *(f"{x:.4f}" for x in figures)])
