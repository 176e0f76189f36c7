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
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from dataclasses import asdict, replace
from functools import partial
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.harness import Kind, Row, Trial
from benchmarks.training.goals import Goal, mean_of
from benchmarks.training.lessons import LESSONS, Lesson
from benchmarks.training.transfer import play_transfer, write_places, write_shares
from fleet.charts.curves import XyCurve, draw_curves
from fleet.charts.statistics import estimate
from fleet.training.evaluation import RETURN
from fleet.training.recipes import RECIPES
from fleet.training.results import CONFIG, EPISODES, EVALUATION, PROGRESS, SCRIPTED, STEPS
from fleet.training.settings import told_ppo

N_AT_ONCE = 2
N_QUICK_EPISODES, N_QUICK_STEPS = 2, 20_000
N_POINTS = 60
"""Points of a curve in the documents."""

_REPOSITORY = Path(__file__).resolve().parents[2]
FOLDER = _REPOSITORY / "runs" / "learning"
DOCUMENTS = _REPOSITORY / "docs" / "learning"


def measure_lesson(recipe: str, trial: Trial) -> Iterable[Row]:
    """Train a recipe from every seed, and compare."""
    if importlib.util.find_spec("torch") is None:
        trial.notes.append(f"{recipe}: left out, PyTorch is not installed: pip install '.[train]'")
        return
    lesson = LESSONS[recipe]
    with tempfile.TemporaryDirectory() as quick:
        folder = Path(quick) if trial.quick else FOLDER
        with ThreadPoolExecutor(N_AT_ONCE) as pool:
            problems = list(
                pool.map(lambda seed: train_seed(folder, recipe, lesson, seed, quick=trial.quick), trial.seeds)
            )
        for seed, problem in zip(trial.seeds, problems, strict=True):
            trial.check(problem is None, f"{recipe}, seed {seed}: {problem}")
        if trial.failures:
            return
        runs = [folder / recipe / str(seed) for seed in trial.seeds]
        elsewhere = _play_elsewhere(recipe, lesson, runs)
        yield from _rows(recipe, lesson, runs, elsewhere, promised=not trial.quick)
        if not trial.quick:
            _document(recipe, lesson, trial.seeds, runs, elsewhere)


def train_seed(folder: Path, recipe: str, lesson: Lesson, seed: int, *, quick: bool) -> str | None:
    """Run one seed to its end; returns what went wrong."""
    out = folder / recipe / str(seed)
    if (out / CONFIG).exists() and (other := _other_settings(out, recipe)) and not quick:
        return f"{out} was trained with other {other}; valid: remove it, to train again"
    if (out / EVALUATION).exists():
        return None
    out.mkdir(parents=True, exist_ok=True)
    command = [sys.executable, "-m", "fleet", "train", "--env", recipe, "--seed", str(seed), "--out", str(out)]
    command += ["--resume", "--episodes", str(N_QUICK_EPISODES if quick else lesson.n_episodes)]
    if quick:
        command += ["--steps", str(N_QUICK_STEPS), "--fidelity", lesson.fidelity]
    # One core each: the numerical libraries would else fight for both.
    environment = {**os.environ, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}
    with (out / "log.txt").open("a", encoding="utf-8") as log:
        status = subprocess.run(command, cwd=_REPOSITORY, stdout=log, stderr=log, env=environment, check=False)
    return None if status.returncode == 0 else f"status {status.returncode}, see {out / 'log.txt'}"


def _other_settings(out: Path, recipe: str) -> str:
    """Names of the settings in which a run differs from today's recipe, empty if it is the same."""
    found = RECIPES[recipe]
    today = {"steps_n": found.n_steps, "arguments": found.arguments, "ppo": asdict(found.ppo)}
    today["stages"] = list(map(asdict, found.stages))
    was = json.loads((out / CONFIG).read_text(encoding="utf-8"))
    was["ppo"] = told_ppo(was.get("ppo", {}))
    return ", ".join(name for name, value in today.items() if was.get(name) != json.loads(json.dumps(value)))


def _play_elsewhere(recipe: str, lesson: Lesson, runs: Sequence[Path]) -> dict[str, list[Path]]:
    """Play what was learned in all places, two at a time: each takes minutes; returns the folders, by place."""
    with ProcessPoolExecutor(N_AT_ONCE, mp_context=get_context("spawn")) as pool:
        begun = {
            name: [pool.submit(play_transfer, recipe, out, name, place) for out in runs]
            for name, place in lesson.places.items()
        }
        return {name: [one.result() for one in of_runs] for name, of_runs in begun.items()}


def longest(runs: Sequence[Path], minutes: float, *, promised: bool) -> Row:
    """Time of the seed that took longest to train."""
    spent_s = max(_evaluation(out)["train_cpu_s"] for out in runs)
    target = f"<= {minutes:g}" if promised else ""
    return Row(name="  longest seed", value=spent_s / 60.0, unit="min of CPU", kind=Kind.TIME, target=target)


def _rows(
    recipe: str, lesson: Lesson, runs: Sequence[Path], elsewhere: Mapping[str, Sequence[Path]], *, promised: bool
) -> Iterable[Row]:
    """Rows of a lesson: where it was learned, how long it took, and everywhere else."""
    yield from _told(lesson, f"{recipe}: ", runs, lesson.goals, promised=promised)
    if lesson.level_with:
        yield from _gains(lesson, [_evaluation(out) for out in runs], promised=promised)
    yield longest(runs, lesson.minutes, promised=promised)
    for name, place in lesson.places.items():
        yield from _told(lesson, f"  {name}: ", elsewhere[name], place.goals, promised=promised)


def _told(
    lesson: Lesson, where: str, folders: Sequence[Path], goals: Iterable[Goal], *, promised: bool
) -> Iterable[Row]:
    """Means over the seeds for all who played, and what is promised."""
    for policy in _evaluation(folders[0])["policies"]:
        if lesson.success is None:
            yield Row(
                name=f"{where}{lesson.figure}, {policy}",
                value=mean_of(folders, lesson.figure, policy),
                unit="per episode",
            )
        else:
            won, n = lesson.success.successes(folders)[policy]
            yield Row(name=f"{where}success, {policy}", value=won / n, unit=f"of 1; {won} of {n}")
    for goal in goals:
        row = goal.row(folders)
        yield replace(row, name=f"{where}{row.name}", target=goal.target if promised else "")


def _gains(lesson: Lesson, found: Sequence[Mapping[str, Any]], *, promised: bool) -> Iterable[Row]:
    """The lower ends of the gains' intervals over the seeds, which are what is promised."""
    for policy in found[0]["gain"]:
        for name in (lesson.figure, RETURN):
            gained = estimate([one["gain"][policy][name]["mean"] for one in found])
            assert gained is not None
            unit = "per episode, lower end of 95 %" if len(found) > 1 else "per episode"
            value = gained.low if len(found) > 1 else gained.mean
            level = -0.02 * abs(np.mean([one["policies"][policy][name]["mean"] for one in found]))
            target = f">= {level:.4g}" if policy == SCRIPTED else ">= 0"
            kept = promised and policy in lesson.level_with
            yield Row(name=f"  learned - {policy}, {name}", value=value, unit=unit, target=target if kept else "")


def _evaluation(folder: Path) -> dict[str, Any]:
    found: dict[str, Any] = json.loads((folder / EVALUATION).read_text(encoding="utf-8"))
    return found


def _document(
    recipe: str,
    lesson: Lesson,
    seeds: Sequence[int],
    runs: Sequence[Path],
    elsewhere: Mapping[str, Sequence[Path]],
) -> None:
    """Write curve, figures, settings and successes of a recipe."""
    DOCUMENTS.mkdir(parents=True, exist_ok=True)
    # Who only clones does from the first what a teacher does.
    if lesson.has_curve and RECIPES[recipe].ppo.clone_n < RECIPES[recipe].n_steps:
        _draw(recipe, seeds, runs)
    with (DOCUMENTS / f"{recipe}_episodes.csv").open("w", encoding="utf-8", newline="") as file:
        for seed, out in zip(seeds, runs, strict=True):
            head, *lines = (out / EPISODES).read_text(encoding="utf-8").splitlines()
            lines = [f"{seed},{line}" for line in lines]
            file.write("\n".join(([f"trained_from,{head}"] if seed == seeds[0] else []) + lines) + "\n")
    if elsewhere:
        write_places(DOCUMENTS / f"{recipe}_places.csv", elsewhere)
    config = json.loads((runs[0] / CONFIG).read_text(encoding="utf-8"))
    settings = {key: value for key, value in config.items() if key not in ("seed", "versions")}
    (DOCUMENTS / f"{recipe}.json").write_text(json.dumps(settings, indent=2) + "\n", encoding="utf-8")
    if lesson.success is not None:
        fidelities = {lesson.fidelity: runs, "physics": [out / "physics" for out in runs]}
        folders = {("all", fidelity): list(played) for fidelity, played in fidelities.items()}
        for fidelity, played in fidelities.items():
            folders |= {(str(seed), fidelity): [one] for seed, one in zip(seeds, played, strict=True)}
        write_shares(DOCUMENTS / f"{recipe}_success.csv", folders, lesson.success)


def _draw(recipe: str, seeds: Sequence[int], runs: Sequence[Path]) -> None:
    """Write how the chief figure went while it was learned, as a table and a picture."""
    chief = RECIPES[recipe].figures[0]
    tables = []
    for out in runs:
        with (out / PROGRESS).open(encoding="utf-8", newline="") as file:
            tables.append(list(csv.DictReader(file)))
    steps, curves = _on_a_grid(tables, chief)
    with (DOCUMENTS / f"{recipe}_curve.csv").open("w", encoding="utf-8", newline="") as file:
        table = csv.writer(file, lineterminator="\n")
        table.writerow(["steps", *(f"seed_{seed}" for seed in seeds)])
        table.writerows([f"{step:.0f}", *(f"{y:.4g}" for y in row)] for step, row in zip(steps, curves.T, strict=True))
    middle = curves.mean(axis=0)
    band = [(float(low), float(high)) for low, high in zip(curves.min(axis=0), curves.max(axis=0), strict=True)]
    curve = [XyCurve(name="learned", points=list(zip(steps.tolist(), middle.tolist(), strict=True)), band=band)]
    found = [_evaluation(out) for out in runs]
    for policy in found[0]["gain"]:
        level = float(np.mean([one["policies"][policy][chief]["mean"] for one in found]))
        curve.append(XyCurve(name=policy, points=[(float(steps[-1]), level)]))
    title = f"{recipe}: {chief} per episode while learning, {len(seeds)} seeds (band: all of them)"
    draw_curves(title, STEPS, chief, curve).write_png(DOCUMENTS / f"{recipe}.png")


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


GROUPS: dict[str, Callable[[Trial], Iterable[Row]]] = {recipe: partial(measure_lesson, recipe) for recipe in LESSONS}
"""What trains each recipe, by its name."""
