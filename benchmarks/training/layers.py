"""Layers: what the environments of dispatch and traffic cost on the grid, and what policies of dispatch deliver."""

from __future__ import annotations

import csv
import importlib
import os
import time
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.harness import Kind, Row, Trial
from fleet.abstract.fleet import TIMESTEP_S, FleetSite, GridFleet
from fleet.charts.chart import Series, draw
from fleet.charts.statistics import Estimate, estimate
from fleet.envs import dispatch_v1, traffic_v1
from fleet.envs.dispatch.env import DispatchEnv
from fleet.envs.layers.layer import LayerEnv
from fleet.envs.layers.order_streams import episode_orders
from fleet.envs.policies import POLICIES, Policy, make_policy
from fleet.envs.traffic.env import TrafficEnv
from maps.site import Site, load_site
from maps.warehouse import generate_warehouse

LOAD = 1.5
N_CYCLES = 300
"""Steps of an episode whose speed is measured; its reset counts."""
N_ACTIONS = 50
TARGET = ">= 200000"
TEAMS, QUICK_TEAMS = (4, 8, 16, 32), (4, 16)
N_SEEDS, N_QUICK_SEEDS = 10, 2
OUT = Path("runs/dispatch_table")
LEARNED = "DISPATCH_POLICY"
"""Environment variable: folder of a training run of `fleet.train --env dispatch`, whose policy joins the table."""


def measure_grid(trial: Trial) -> Iterator[Row]:
    """Agent steps per second of CPU time, resets included; the fastest of several rounds."""
    n_rounds = 3 if trial.quick else 7
    for n_cars, site in _floors():
        env = traffic_v1.parallel_env(site=site, n_cars=n_cars, load=LOAD, max_cycles=N_CYCLES)
        _check_traffic(trial, env)
        rate = max(_rate(env, seed) for seed in range(n_rounds))
        target = TARGET if n_cars >= 256 else ""
        yield Row(
            name=f"traffic_v1, {n_cars} cars, {site.name}",
            value=rate,
            unit="agent steps/s",
            kind=Kind.RATE,
            target=target,
        )
        dispatch = dispatch_v1.parallel_env(site=site, n_cars=n_cars, load=LOAD, max_cycles=N_CYCLES // 5)
        rate = max(_rate(dispatch, seed) for seed in range(n_rounds))
        yield Row(name="  dispatch_v1", value=rate, unit="agent steps/s", kind=Kind.RATE)
        rate = max(_engine_rate(env.place, n_cars, seed) for seed in range(n_rounds))
        yield Row(name="  the fleet alone, with PIBT", value=rate, unit="agent steps/s", kind=Kind.RATE)
    trial.notes.append(
        f"Per second of CPU time of one process: {N_CYCLES} steps (dispatch: a fifth, of five timesteps each) of "
        "random actions and a reset, dictionaries of PettingZoo included; the actions are drawn before."
    )


def measure_table(trial: Trial) -> Iterator[Row]:
    """Deliveries of every policy of dispatch against team size, and how late they were."""
    teams = QUICK_TEAMS if trial.quick else TEAMS
    n_seeds = N_QUICK_SEEDS if trial.quick else N_SEEDS
    minds: dict[str, Callable[[int], Policy]] = {**POLICIES["dispatch"], **_learned(trial)}
    OUT.mkdir(parents=True, exist_ok=True)
    table: list[tuple[object, ...]] = []
    for site in _choosy_floors():
        curves: dict[str, list[Estimate | None]] = {name: [] for name in minds}
        for n_cars in teams:
            env = dispatch_v1.parallel_env(site=site, n_cars=n_cars, load=LOAD)
            for name, make in minds.items():
                told = [_played(env, make(seed), seed) for seed in range(n_seeds)]
                rate, late = (estimate([one[k] for one in told]) for k in range(2))
                if rate is None or late is None:
                    continue
                curves[name].append(estimate([one[0] / n_cars for one in told]))
                ends = (rate.mean, rate.half_width, late.mean, late.half_width)
                table.append((site.name, n_cars, name, *(f"{value:.4g}" for value in ends)))
                where = f"{site.name}, {n_cars} cars, {name}"
                yield Row(name=f"{where}: deliveries (± {rate.half_width:.2g})", value=rate.mean, unit="1/h")
                yield Row(
                    name=f"  mean tardiness (± {late.half_width:.2g})", value=late.mean, unit="s", kind=Kind.PLAIN
                )
            env.close()
        sheet = draw(
            f"Dispatch on {site.name}",
            "deliveries per car and hour, 95 % intervals",
            [Series(name=name, x=tuple(teams), y=tuple(curves[name])) for name in minds],
        )
        (OUT / f"dispatch_{site.name}.svg").write_text(sheet.svg() + "\n", encoding="utf-8")
    with (OUT / "dispatch.csv").open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(("site", "cars", "policy", "deliveries_per_h", "half_width", "tardiness_s", "half_width"))
        writer.writerows(table)
    trial.notes.append(
        f"dispatch_v1, fidelity grid, {LOAD:g} times the orders that the cars could carry without traffic, {n_seeds} "
        "episodes of 20 minutes, the same orders for all policies; right of way by PIBT; 95 % intervals. Plots and "
        f"table: {OUT}"
    )


def _choosy_floors() -> tuple[Site, ...]:
    """A shipped floor, where all ways are long and choice matters little, and a narrow one along which it is all."""
    return load_site("medium"), generate_warehouse(rows=60, cols=20, pick=10, drop=10, parking=32, name="narrow")


def _floors() -> tuple[tuple[int, Site], ...]:
    return (
        (16, load_site("medium")),
        (256, generate_warehouse(rows=80, cols=100, pick=24, drop=24, parking=256)),
        (1000, generate_warehouse(rows=150, cols=160, pick=46, drop=46, parking=1000)),
    )


def _rate(env: LayerEnv, seed: int) -> float:
    """Agent steps per second of CPU time in one episode."""
    rng, n = np.random.default_rng(seed), len(env.possible_agents)
    n_actions = int(env.action_space("car_0").n)  # type: ignore[attr-defined]
    plays = [
        dict(zip(env.possible_agents, rng.integers(n_actions, size=n).tolist(), strict=True)) for _ in range(N_ACTIONS)
    ]
    began, n_steps = time.process_time(), 0
    env.reset(seed=seed)
    while env.agents:
        env.step(plays[n_steps % N_ACTIONS])
        n_steps += 1
    return n_steps * n / (time.process_time() - began)


def _engine_rate(place: FleetSite, n_cars: int, seed: int) -> float:
    rng = np.random.default_rng(seed)
    grid = GridFleet(place, n_cars, episode_orders(place, n_cars, LOAD, N_CYCLES * TIMESTEP_S, rng), seed)
    began = time.process_time()
    for _ in range(N_CYCLES):
        grid.assign_nearest()
        grid.move(grid.planned())
    return N_CYCLES * n_cars / (time.process_time() - began)


def _check_traffic(trial: Trial, env: TrafficEnv) -> None:
    """PIBT as a policy is granted every move, and cars never share a cell whatever agents choose."""
    rng, n = np.random.default_rng(0), len(env.possible_agents)
    for name in ("pibt", "random"):
        mind = make_policy("traffic", name)
        observations, _ = env.reset(seed=0)
        for _ in range(N_CYCLES if n <= 256 else 60):
            wild = dict(zip(env.possible_agents, rng.integers(-1, 6, size=n).tolist(), strict=True))
            actions = mind.act(env, observations) if name == "pibt" else wild
            observations, *_, infos = env.step(actions)
            cells = env.place.graph.state_cell[env.view.state]
            trial.check(len(np.unique(cells)) == n, f"{n} cars, {name}: two cars in one cell")
            refused = name == "pibt" and any(info["waits"] or info["pushed"] for info in infos.values())
            trial.check(not refused, f"{n} cars: a move of PIBT was not granted")
        trial.check(name != "pibt" or n > 256 or env.n_delivered > 0, f"{n} cars, {name}: nothing delivered")


def _played(env: DispatchEnv, mind: Any, seed: int) -> tuple[float, float]:
    """Deliveries per hour, and their mean tardiness [s]."""
    observations, _ = env.reset(seed=seed)
    n_steps = 0
    while env.agents:
        observations, *_ = env.step(mind.act(env, observations))
        n_steps += 1
    hours = n_steps * 5.0 / 3600.0
    return env.n_delivered / hours, env.late_s / max(1, env.n_delivered)


def _learned(trial: Trial) -> dict[str, Callable[[int], Policy]]:
    folder = os.environ.get(LEARNED)
    if not folder:
        trial.notes.append(f"no learned policy: {LEARNED} names no folder of a training run")
        return {}
    policy: Policy = importlib.import_module("fleet.training.ppo.trainer").load_policy(Path(folder))
    return {"learned": lambda seed: policy}


GROUPS: dict[str, Callable[[Trial], Iterable[Row]]] = {"grid": measure_grid, "table": measure_table}
