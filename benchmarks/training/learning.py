"""Learning: what PPO makes of every recipe from several seeds, beside a script and chance on the same episodes.

Every seed is a run of `python -m fleet train` in `runs/learning/<recipe>/<seed>`, two at a time; what is there already
is kept, and a run that was interrupted goes on from its checkpoint. What learned without physics for its speed is
played with physics as well. A full run writes its curves, figures and settings to `docs/learning`.
"""

from __future__ import annotations

import csv
import importlib.util
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.harness import Kind, Row, Trial
from benchmarks.training.transfer import SHARES, TRANSFERS, play_transfer, write_shares
from fleet.charts.statistics import estimate
from fleet.training.curve import LearningCurve, draw_curves
from fleet.training.recipes import RECIPES
from fleet.training.results import EPISODES, EVALUATION, LEARNED, PROGRESS, SCRIPTED

LEARNED_RECIPES = ("navigate", "dispatch", "reach")
N_AT_ONCE = 2
N_EPISODES, N_QUICK_EPISODES = {"navigate": 40, "dispatch": 40, "reach": 100, "traffic": 20}, 2
N_QUICK_STEPS = 20_000
QUICK_ARGUMENTS = {"navigate": "kinematic", "dispatch": "grid", "reach": "kinematic", "traffic": "grid"}
"""Fidelities of a quick run."""
MINUTES = {"navigate": 30, "dispatch": 30, "reach": 15}
"""Longest time of a seed on one core."""
PLACES = (">= 1.05", ">= 1.1")
"""Places of `navigate` in physics, as a multiple of the script's: on sites and with teams that were not learned on, and
where it learned."""
N_POINTS = 60
"""Points of a curve in the documents."""

_REPOSITORY = Path(__file__).resolve().parents[2]
FOLDER = _REPOSITORY / "runs" / "learning"
DOCUMENTS = _REPOSITORY / "docs" / "learning"


def measure_learning(trial: Trial) -> Iterable[Row]:
    """Train every recipe from every seed, and compare."""
    if importlib.util.find_spec("torch") is None:
        trial.notes.append("learning: left out, PyTorch is not installed: pip install '.[train]'")
        return
    with tempfile.TemporaryDirectory() as quick:
        folder = Path(quick) if trial.quick else FOLDER
        jobs = [(recipe, seed) for recipe in LEARNED_RECIPES for seed in trial.seeds]
        with ThreadPoolExecutor(N_AT_ONCE) as pool:
            problems = list(pool.map(lambda job: train_seed(folder, *job, quick=trial.quick), jobs))
        for (recipe, seed), problem in zip(jobs, problems, strict=True):
            trial.check(problem is None, f"{recipe}, seed {seed}: {problem}")
        if trial.failures:
            return
        for recipe in LEARNED_RECIPES:
            runs = [folder / recipe / str(seed) for seed in trial.seeds]
            found = [_read(out) for out in runs]
            yield from _rows(recipe, found, promised=not trial.quick)
            if not trial.quick:
                _document(recipe, trial.seeds, found)
            for where in TRANSFERS.get(recipe, {}):
                played = [play_transfer(recipe, out, where) for out in runs]
                yield from _transfer_rows(recipe, where, played, promised=not trial.quick)
                if recipe in SHARES and not trial.quick:
                    _document_shares(recipe, trial.seeds, runs, played)


def train_seed(folder: Path, recipe: str, seed: int, *, quick: bool) -> str | None:
    """Run one seed to its end; returns what went wrong."""
    out = folder / recipe / str(seed)
    if (out / EVALUATION).exists():
        return None
    out.mkdir(parents=True, exist_ok=True)
    command = [sys.executable, "-m", "fleet", "train", "--env", recipe, "--seed", str(seed), "--out", str(out)]
    command += ["--resume", "--episodes", str(N_QUICK_EPISODES if quick else N_EPISODES[recipe])]
    if quick:
        command += ["--steps", str(N_QUICK_STEPS), "--fidelity", QUICK_ARGUMENTS[recipe]]
    # One core each: the numerical libraries would else fight for both.
    environment = {**os.environ, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}
    with (out / "log.txt").open("a", encoding="utf-8") as log:
        status = subprocess.run(command, cwd=_REPOSITORY, stdout=log, stderr=log, env=environment, check=False)
    return None if status.returncode == 0 else f"status {status.returncode}, see {out / 'log.txt'}"


def _read(out: Path) -> dict[str, Any]:
    found: dict[str, Any] = json.loads((out / EVALUATION).read_text(encoding="utf-8"))
    with (out / PROGRESS).open(encoding="utf-8", newline="") as table:
        found["progress"] = list(csv.DictReader(table))
    found["config"] = json.loads((out / "config.json").read_text(encoding="utf-8"))
    found["episodes_csv"] = (out / EPISODES).read_text(encoding="utf-8")
    return found


def _rows(recipe: str, found: Sequence[Mapping[str, Any]], *, promised: bool) -> Iterable[Row]:
    """Means over the seeds, and the lower end of the gain's interval, which is what is promised."""
    chief = RECIPES[recipe].figures[0]
    for policy in found[0]["policies"]:
        values = [one["policies"][policy][chief]["mean"] for one in found]
        target = ">= 0.95" if promised and recipe == "reach" and policy == "learned" else ""
        yield Row(name=f"{recipe}: {chief}, {policy}", value=float(np.mean(values)), unit="per episode", target=target)
    for policy in found[0]["gain"]:
        for name in (chief, "return"):
            gained = estimate([one["gain"][policy][name]["mean"] for one in found])
            assert gained is not None
            unit = "per episode, lower end of 95 %" if len(found) > 1 else "per episode"
            value = gained.low if len(found) > 1 else gained.mean
            # Nobody can do better than the script where that never fails.
            kept = promised and not (recipe == "reach" and policy == SCRIPTED)
            level = -0.02 * abs(np.mean([one["policies"][policy][name]["mean"] for one in found]))
            target = "" if not kept else f">= {level:.4g}" if policy == SCRIPTED else ">= 0"
            yield Row(name=f"  learned - {policy}, {name}", value=value, unit=unit, target=target)
    minutes = max(one["train_cpu_s"] for one in found) / 60.0
    target = f"<= {MINUTES[recipe]}" if promised else ""
    yield Row(name="  longest seed", value=minutes, unit="min of CPU", kind=Kind.TIME, target=target)


def _transfer_rows(recipe: str, where: str, played: Sequence[Path], *, promised: bool) -> Iterable[Row]:
    """Means over the seeds somewhere else; of `navigate` also what was learned as a multiple of the script's."""
    found = [json.loads((folder / EVALUATION).read_text(encoding="utf-8"))["policies"] for folder in played]
    chief = RECIPES[recipe].figures[0]
    for policy in found[0]:
        value = float(np.mean([one[policy][chief]["mean"] for one in found]))
        target = ">= 0.95" if promised and recipe in SHARES and policy == LEARNED else ""
        yield Row(name=f"  {where}: {chief}, {policy}", value=value, unit="per episode", target=target)
    if recipe != "navigate":
        return
    for name, target in (("places", PLACES[where == "physics"]), ("touches", "<= 1.0")):
        shares = [one[LEARNED][name]["mean"] / max(one[SCRIPTED][name]["mean"], 1e-9) for one in found]
        gained = estimate(shares)
        assert gained is not None
        value = gained.mean if len(shares) == 1 else gained.low if name == "places" else gained.high
        unit = "times the script's, the worse end of 95 %"
        yield Row(name=f"  {where}: {name}, learned", value=value, unit=unit, target=target if promised else "")


def _document_shares(recipe: str, seeds: Sequence[int], runs: Sequence[Path], played: Sequence[Path]) -> None:
    """Write how often every seed succeeded at both fidelities, with intervals."""
    fidelities = {str(RECIPES[recipe].arguments["fidelity"]): runs, "physics": played}
    folders = {("all", fidelity): list(found) for fidelity, found in fidelities.items()}
    for fidelity, found in fidelities.items():
        folders |= {(str(seed), fidelity): [one] for seed, one in zip(seeds, found, strict=True)}
    write_shares(DOCUMENTS / f"{recipe}_success.csv", folders, RECIPES[recipe].figures[0])


def _document(recipe: str, seeds: Sequence[int], found: Sequence[Mapping[str, Any]]) -> None:
    """Write curve, figures and settings of a recipe."""
    DOCUMENTS.mkdir(parents=True, exist_ok=True)
    chief = RECIPES[recipe].figures[0]
    steps, curves = _on_a_grid([one["progress"] for one in found], chief)
    with (DOCUMENTS / f"{recipe}_curve.csv").open("w", encoding="utf-8", newline="") as file:
        table = csv.writer(file, lineterminator="\n")
        table.writerow(["steps", *(f"seed_{seed}" for seed in seeds)])
        table.writerows([f"{step:.0f}", *(f"{y:.4g}" for y in row)] for step, row in zip(steps, curves.T, strict=True))
    with (DOCUMENTS / f"{recipe}_episodes.csv").open("w", encoding="utf-8", newline="") as file:
        for seed, one in zip(seeds, found, strict=True):
            head, *lines = one["episodes_csv"].splitlines()
            lines = [f"{seed},{line}" for line in lines]
            file.write("\n".join(([f"trained_from,{head}"] if seed == seeds[0] else []) + lines) + "\n")
    settings = {key: value for key, value in found[0]["config"].items() if key not in ("seed", "versions")}
    (DOCUMENTS / f"{recipe}.json").write_text(json.dumps(settings, indent=2) + "\n", encoding="utf-8")
    middle = curves.mean(axis=0)
    band = [(float(low), float(high)) for low, high in zip(curves.min(axis=0), curves.max(axis=0), strict=True)]
    lines = [LearningCurve(name="learned", points=list(zip(steps.tolist(), middle.tolist(), strict=True)), band=band)]
    for policy in found[0]["gain"]:
        level = float(np.mean([one["policies"][policy][chief]["mean"] for one in found]))
        lines.append(LearningCurve(name=policy, points=[(float(steps[-1]), level)]))
    title = f"{recipe}: {chief} per episode while learning, {len(seeds)} seeds (band: all of them)"
    draw_curves(title, chief, lines).write_png(DOCUMENTS / f"{recipe}.png")


def _on_a_grid(
    tables: Sequence[Sequence[Mapping[str, str]]], figure: str
) -> tuple[np.ndarray[Any, np.dtype[np.float64]], np.ndarray[Any, np.dtype[np.float64]]]:
    """Curves of all seeds at common steps: shapes (k,) and (n_seeds, k); each value is a mean of what is near it."""
    known = [
        np.array([(float(row["steps"]), float(row[figure])) for row in table if row[figure]], dtype=np.float64)
        for table in tables
    ]
    end = min(curve[-1, 0] for curve in known)
    width = end / N_POINTS
    steps = (np.arange(N_POINTS) + 1.0) * width
    curves = np.empty((len(known), N_POINTS))
    for row, curve in zip(curves, known, strict=True):
        for k, step in enumerate(steps):
            near = np.abs(curve[:, 0] - step) <= width
            row[k] = curve[near, 1].mean() if near.any() else np.interp(step, curve[:, 0], curve[:, 1])
    return steps, curves
