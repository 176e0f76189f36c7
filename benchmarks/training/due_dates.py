"""Due dates: how late every policy of dispatch is in every scenario, episode by episode."""

from __future__ import annotations

import csv
import time
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.harness import Kind, Row, Trial
from fleet.abstract.fleet import TIMESTEP_S, late_steps, one_per_order
from fleet.abstract.kernel import NEVER, Stage
from fleet.charts.statistics import estimate
from fleet.envs import dispatch_v1
from fleet.envs.dispatch.env import DispatchEnv
from fleet.envs.dispatch.scenarios import SCENARIOS
from fleet.envs.policies import POLICIES, Policy, make_policy
from maps.warehouse import generate_warehouse

FIRST_SEED = 50_000
"""Nothing is trained or chosen on episodes from here on."""
N_SEEDS, N_QUICK_SEEDS, N_QUICK_CYCLES = 20, 2, 24
ELSEWHERE = "due_rush"
"""Scenario that is played on the held-out floors, too."""
HELD_OUT_SITES: dict[str, dict[str, Any]] = {
    "narrow_held_out": {"rows": 30, "cols": 14, "pick": 3, "drop": 3, "parking": 12},
    "wide_held_out": {"rows": 14, "cols": 30, "pick": 3, "drop": 3, "parking": 12},
    "square_held_out": {"rows": 20, "cols": 22, "pick": 4, "drop": 4, "parking": 16},
}
"""Floors that nothing is trained on: arguments of `maps.warehouse.generate_warehouse`, by name."""
HEAD = ("scenario", "policy", "seed", "delivered", "tardiness_min", "on_time", "cpu_s")
EPISODES = Path("runs/dispatch_due/episodes.csv")
TABLE = Path("docs/learning/dispatch_due.csv")
ROLLOUT = "rollout"
ROLLOUT_TARGET = "<= 2"
"""Seconds of CPU of an episode of 20 minutes with 6 cars."""


def measure_due_dates(trial: Trial) -> Iterator[Row]:
    """Play what was not played before, and tell means with 95 % intervals."""
    n_seeds = N_QUICK_SEEDS if trial.quick else N_SEEDS
    known = {} if trial.quick else _read(EPISODES)
    table: list[tuple[object, ...]] = []
    for scenario, arguments in _cases().items():
        env = dispatch_v1.parallel_env(**arguments, **({"max_cycles": N_QUICK_CYCLES} if trial.quick else {}))
        for policy in POLICIES["dispatch"]:
            told = []
            for seed in range(n_seeds):
                key = (scenario, policy, str(seed))
                if key not in known:
                    figures = played(env, make_policy("dispatch", policy, seed), FIRST_SEED + seed)
                    written = [f"{value:.4g}" for value in figures]
                    known[key] = tuple(map(float, written))
                    if not trial.quick:
                        _append(EPISODES, (*key, *written))
                told.append(known[key])
            yield from _rows(scenario, policy, told, table, promised=not trial.quick and env.config.n_cars == 6)
        env.close()
    if not trial.quick:
        with TABLE.open("w", encoding="utf-8", newline="") as file:
            writer = csv.writer(file, lineterminator="\n")
            columns = [f"{name}{end}" for name in HEAD[3:6] for end in ("", "_half_width")]
            writer.writerow(("scenario", "policy", "episodes", *columns))
            writer.writerows(table)
    trial.notes.append(
        f"dispatch_v1, fidelity grid, {n_seeds} episodes of 20 minutes, the same orders for all policies; tardiness of "
        f"all orders that came in, minutes an episode; ± 95 %. Episodes: {EPISODES}; those that are there are not "
        f"played again. Table: {TABLE}"
    )


def _cases() -> dict[str, dict[str, Any]]:
    """Settings by name: every scenario, and one of them on the floors that nothing is trained on."""
    cases = {name: dict(scenario.arguments) for name, scenario in SCENARIOS.items()}
    rush = SCENARIOS[ELSEWHERE].arguments
    sites = [generate_warehouse(**settings, name=name) for name, settings in HELD_OUT_SITES.items()]
    return cases | {f"{ELSEWHERE} on {site.name}": {**rush, "site": site} for site in sites}


def played(env: DispatchEnv, policy: Policy, seed: int) -> tuple[float, float, float, float]:
    """Deliveries, tardiness [min], share of what was due that was in time, and CPU time [s] of one episode."""
    observations, _ = env.reset(seed=seed)
    began = time.process_time()
    while env.agents:
        observations, *_ = env.step(policy.act(env, observations))
    cpu_s = time.process_time() - began
    grid: Any = env.fleet.grid  # type: ignore[union-attr]
    tasks = grid.tasks
    is_done = tasks.stage == Stage.DELIVERED
    late = late_steps(tasks, grid.now)
    is_in = (tasks.release <= grid.now) & one_per_order(tasks)
    is_due = (tasks.due != NEVER) & is_in & ((tasks.due <= grid.now) | is_done)
    n_due = int(np.count_nonzero(is_due))
    on_time = int(np.count_nonzero(is_due & is_done & (late == 0))) / max(1, n_due)
    return float(env.n_delivered), float(late.sum()) * TIMESTEP_S / 60.0, on_time, cpu_s


def _rows(
    scenario: str,
    policy: str,
    told: Sequence[Sequence[float]],
    table: list[tuple[object, ...]],
    *,
    promised: bool,
) -> Iterable[Row]:
    found = [estimate([one[k] for one in told]) for k in range(3)]
    ends = [value for one in found if one is not None for value in (one.mean, one.half_width)]
    table.append((scenario, policy, len(told), *(f"{value:.4g}" for value in ends)))
    names, units = ("tardiness", "deliveries", "in time"), ("min", "per episode", "of 1")
    for name, unit, one in zip(names, units, (found[1], found[0], found[2]), strict=True):
        if one is not None:
            title = f"{scenario}, {policy}: {name}" if name == names[0] else f"  {name}"
            yield Row(name=f"{title} (± {one.half_width:.2g})", value=one.mean, unit=unit, kind=Kind.PLAIN)
    if policy == ROLLOUT:
        target = ROLLOUT_TARGET if promised else ""
        cpu_s = float(np.median([one[3] for one in told]))  # the first one compiles
        yield Row(name="  CPU time of an episode", value=cpu_s, unit="s", kind=Kind.TIME, target=target)


def _read(path: Path) -> dict[tuple[str, str, str], tuple[float, ...]]:
    if not path.exists():
        return {}
    with path.open(encoding="utf-8", newline="") as file:
        return {tuple(row[:3]): tuple(map(float, row[3:])) for row in list(csv.reader(file))[1:]}  # type: ignore[misc]


def _append(path: Path, row: Sequence[object]) -> None:
    is_new = not path.exists()
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("a", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerows([HEAD, row] if is_new else [row])
