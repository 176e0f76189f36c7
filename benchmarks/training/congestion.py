"""Congestion: what the recipe `traffic` makes of crowded floors, beside PIBT and the best planner.

Seeds are trained as those of `learning` are, in `runs/learning/traffic/<seed>`. All play the same episodes, of other
seeds than those of the training; the large floor is none of those that were trained on.
"""

from __future__ import annotations

import importlib.util
import tempfile
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.harness import Kind, Row, Trial
from benchmarks.training.learning import FOLDER, longest, train_seed
from benchmarks.training.lessons import Lesson
from fleet.charts.statistics import estimate
from fleet.envs import traffic_v1
from fleet.envs.policies.policy import Policy
from fleet.envs.policies.traffic import PibtTraffic, PlannedTraffic

RECIPE = "traffic"
FLOORS = (("dense", 20, 3.0), ("dense", 30, 3.0), ("dense_large", 60, 0.0))
"""Site, cars, and the gain over PIBT that is promised [%]."""
N_EPISODES, N_QUICK_EPISODES = 20, 2
LESSON = Lesson(figure="delivered", minutes=60, n_episodes=N_EPISODES, fidelity="grid")
FIRST_EPISODE = 9000
"""Seed of the first episode; each trained seed plays others."""
ROUNDS = 10
"""Rounds of improvement of the planner that learning is measured against; with them it is the best on these floors."""
LEARNED, PIBT, PLANNED = "learned", "pibt", f"multi_step_pibt, {ROUNDS} rounds"


@dataclass(frozen=True, kw_only=True)
class Crowd:
    """What a policy made of some episodes."""

    delivered: tuple[int, ...]
    n_jams: int
    ms: float
    """Time of computing of a timestep of the whole fleet [ms]."""


def measure_traffic(trial: Trial) -> Iterable[Row]:
    """Train every seed, and play all of them on all floors."""
    if importlib.util.find_spec("torch") is None:
        trial.notes.append("traffic: left out, PyTorch is not installed: pip install '.[train]'")
        return
    from fleet.training.ppo.policy import load_policy

    with tempfile.TemporaryDirectory() as quick:
        folder = Path(quick) if trial.quick else FOLDER
        for seed in trial.seeds:
            problem = train_seed(folder, RECIPE, LESSON, seed, quick=trial.quick)
            trial.check(problem is None, f"{RECIPE}, seed {seed}: {problem}")
        if trial.failures:
            return
        learned = {seed: load_policy(folder / RECIPE / str(seed)) for seed in trial.seeds}
        for site, n_cars, promised in FLOORS:
            played = [
                crowds_of(site, n_cars, {LEARNED: learned[seed]}, _episodes(k, trial.quick))
                for k, seed in enumerate(trial.seeds)
            ]
            yield from _rows(f"{site}, {n_cars} cars", played, promised=None if trial.quick else promised)
        runs = [folder / RECIPE / str(seed) for seed in trial.seeds]
        yield longest(runs, LESSON.minutes, promised=not trial.quick)
    trial.notes.append(
        "traffic_v1 on the grid, without physics; no two cars ever meet. Gains are those over PIBT on the same "
        "episodes, the lower end of the 95 % interval over the seeds."
    )


def crowds_of(
    site: str, n_cars: int, policies: Mapping[str, Policy], seeds: Sequence[int], **settings: object
) -> dict[str, Crowd]:
    """Let policies, PIBT and the best planner play the same episodes.

    Args:
        site: Name of the site.
        n_cars: Cars.
        policies: By name.
        seeds: One per episode.
        settings: Further settings of the environment.
    """
    env = traffic_v1.parallel_env(site=site, n_cars=n_cars, **settings)
    found = {}
    planners: dict[str, Policy] = {PIBT: PibtTraffic(), PLANNED: PlannedTraffic(settings={"rounds": ROUNDS})}
    for name, policy in {**policies, **planners}.items():
        delivered, n_jams, spent_s, n_steps = [], 0, 0.0, 0
        for seed in seeds:
            observations, _ = env.reset(seed=seed)
            while env.agents:
                began = time.process_time()
                actions = policy.act(env, observations)
                spent_s += time.process_time() - began
                observations, *_ = env.step(actions)
            delivered.append(env.n_delivered)
            n_jams, n_steps = n_jams + env.jammed, n_steps + env.n_steps
        found[name] = Crowd(delivered=tuple(delivered), n_jams=n_jams, ms=1e3 * spent_s / n_steps)
    env.close()
    return found


def gain_percent(crowd: Crowd, other: Crowd) -> float:
    """By how much more was delivered in the same episodes [%]."""
    return 100.0 * (sum(crowd.delivered) / sum(other.delivered) - 1.0)


def _rows(floor: str, played: Sequence[Mapping[str, Crowd]], *, promised: float | None) -> Iterator[Row]:
    for name in played[0]:
        crowds = [one[name] for one in played]
        mean = float(np.mean([crowd.delivered for crowd in crowds]))
        yield Row(name=f"{floor}: delivered, {name}", value=mean, unit="per episode")
        if name != PIBT:
            gained = estimate([gain_percent(one[name], one[PIBT]) for one in played])
            assert gained is not None
            several = len(played) > 1
            yield Row(
                name="  gain over pibt",
                value=gained.low if several else gained.mean,
                unit="%, lower end of 95 %" if several else "%",
                target=f">= {promised:g}" if promised is not None and name == LEARNED else "",
            )
        jams = "<= 0" if promised is not None and name == LEARNED else ""
        n_episodes = sum(len(crowd.delivered) for crowd in crowds)
        yield Row(name="  jams", value=sum(crowd.n_jams for crowd in crowds), unit=f"of {n_episodes}", target=jams)
        yield Row(name="  a timestep", value=float(np.mean([crowd.ms for crowd in crowds])), unit="ms", kind=Kind.TIME)


def _episodes(k: int, quick: bool) -> range:
    n = N_QUICK_EPISODES if quick else N_EPISODES
    return range(FIRST_EPISODE + k * n, FIRST_EPISODE + (k + 1) * n)
