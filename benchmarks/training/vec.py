"""Vec: agent steps per second of CPU time of many environments in one, beside the environments with dictionaries.

Where PyTorch is installed, also of training on both, all in: rollouts and updates.
"""

from __future__ import annotations

import importlib.util
import time
from collections.abc import Iterator
from typing import Any

import numpy as np

from benchmarks.harness import Kind, Row, Trial
from fleet.envs import dispatch_v1, make_vec, traffic_v1
from fleet.envs.vector.loop import LoopVec
from fleet.envs.vector.vec_env import VecEnv
from fleet.training.batch import Batch, EnvBatch
from fleet.training.recipes import RECIPES
from maps.warehouse import generate_warehouse

N_ENVS = 16
N_ACTIONS = 20
MAKERS = {"dispatch": dispatch_v1.parallel_env, "traffic": traffic_v1.parallel_env}
_LARGE = {"rows": 150, "cols": 160, "pick": 46, "drop": 46, "parking": 1000}
TEAMS: tuple[tuple[str, dict[str, Any], str], ...] = (
    ("dispatch", {"site": "small", "n_cars": 6}, ">= 5"),
    ("dispatch", {"site": "medium", "n_cars": 24}, ""),
    ("dispatch", {"n_cars": 1000}, ">= 1.7"),
    ("traffic", {"site": "dense", "n_cars": 20}, ""),
    ("traffic", {"n_cars": 1000}, ">= 1.7"),
)
"""Layer, settings without those of the large floor, and how many times faster it is to be."""


def measure_vec(trial: Trial) -> Iterator[Row]:
    """Steps of both, after a check that both say the same."""
    n_rounds = 2 if trial.quick else 5
    large = generate_warehouse(**_LARGE)  # type: ignore[arg-type]
    for layer, settings, target in TEAMS:
        n_cars, site = settings["n_cars"], settings.get("site", large)
        crowd = n_cars >= 1000
        n_envs, n_steps = (2, 40) if crowd else (N_ENVS, 240)
        told = {"site": site, "n_cars": n_cars, "max_cycles": n_steps}
        name = f"{layer}, {n_cars} cars, {site if isinstance(site, str) else site.name}"
        _check(trial, layer, {**told, "max_cycles": 10 if crowd else 60}, name)
        vec, loop = make_vec(layer, n_envs, **told), LoopVec([MAKERS[layer](**told)])
        rates = np.array([[_rate(vec, seed), _dictionary_rate(loop.single, seed)] for seed in range(n_rounds)])
        fast, slow = rates.max(axis=0).tolist()
        yield Row(name=name, value=fast, unit="agent steps/s", kind=Kind.RATE)
        yield Row(name="  with dictionaries", value=slow, unit="agent steps/s", kind=Kind.RATE)
        yield Row(name="  ratio", value=fast / slow, unit="", target=target)
        vec.close()
        loop.close()
    if importlib.util.find_spec("torch") is None:
        trial.notes.append("training all in: left out, PyTorch is not installed: pip install '.[train]'")
    else:
        yield from _training(trial)
    trial.notes.append(
        "Per second of CPU time of one process and thread: episodes of 240 steps (1,000 cars: 40) of random actions "
        f"and a reset, {N_ENVS} environments in one (1,000 cars: 2) against one; rounds in turn, the fastest of each. "
        "Before that both are played with the same actions, and all that they say is the same to the last bit."
    )


def _training(trial: Trial) -> Iterator[Row]:
    """Agent steps per second of training traffic, by both kinds of batches."""
    recipe = RECIPES["traffic"]
    assert recipe.batch is not None
    dealt = [{**recipe.arguments, "n_cars": 20}] * recipe.ppo.envs_n
    told: dict[str, Any] = {"figures": recipe.figures, "layouts": recipe.layouts, "n_state": 0}
    batches = recipe.batch(dealt, **told), EnvBatch([recipe.make(**one) for one in dealt], **told)
    runs = [_updates(batch, 2 if trial.quick else 6) for batch in batches]
    fast = slow = 0.0
    for (rate, losses), (dictionary_rate, dictionary_losses) in zip(*runs, strict=True):
        trial.check(losses == dictionary_losses, "training all in: losses differ")
        fast, slow = max(fast, rate), max(slow, dictionary_rate)
    yield Row(name="training traffic, 20 cars, dense, all in", value=fast, unit="agent steps/s", kind=Kind.RATE)
    yield Row(name="  with dictionaries", value=slow, unit="agent steps/s", kind=Kind.RATE)
    yield Row(name="  ratio", value=fast / slow, unit="", target=">= 4")
    for batch in batches:
        batch.close()


def _updates(batch: Batch, n_updates: int) -> Iterator[tuple[float, dict[str, float]]]:
    """Train with the recipe's settings; the agent steps per second of CPU time and the losses of each update."""
    import torch

    from fleet.training.ppo.collector import Collector
    from fleet.training.ppo.learner import Learner

    torch.set_num_threads(1)
    ppo, generator = RECIPES["traffic"].ppo, torch.Generator().manual_seed(0)
    learners = {kind.name: Learner(kind, ppo, 0, generator) for kind in batch.types}
    collector = Collector(batch, learners, ppo.discount)
    collector.begin(range(ppo.envs_n), None)
    for _ in range(n_updates):
        began = time.process_time()
        rollouts, _ = collector.roll(ppo.horizon_n, generator)
        losses = learners["car"].learn(rollouts["car"], ppo.learning_rate, 0.0, generator)
        yield ppo.horizon_n * batch.n_agents / (time.process_time() - began), losses


def _check(trial: Trial, layer: str, settings: dict[str, Any], name: str) -> None:
    vec, loop = make_vec(layer, 2, **settings), LoopVec([MAKERS[layer](**settings) for _ in range(2)])
    rng = np.random.default_rng(0)
    view, other = vec.reset(3), loop.reset(3)
    for _ in range(settings["max_cycles"] + 2):
        mask = view.masks["car"]
        alike = all(np.array_equal(view.observations[k], other.observations[k]) for k in view.observations)
        trial.check(alike and np.array_equal(mask, other.masks["car"]), f"{name}: observations differ")
        actions = (rng.random(mask.shape) * mask).argmax(axis=2)
        view, other = step, told = vec.step(actions), loop.step(actions)
        same = np.array_equal(step.rewards["car"], told.rewards["car"]) and np.array_equal(step.ended, told.ended)
        trial.check(same, f"{name}: rewards or ends differ")
    vec.close()
    loop.close()


def _rate(vec: VecEnv, seed: int) -> float:
    rng, group = np.random.default_rng(seed), vec.groups[0]
    n_actions, n_steps = int(group.action.n), vec.single.max_cycles  # type: ignore[union-attr]
    plays = [rng.integers(n_actions, size=(vec.n_envs, group.n)) for _ in range(N_ACTIONS)]
    vec.reset(seed)
    began = time.process_time()
    for step in range(n_steps):  # the last one begins all episodes anew
        vec.step(plays[step % N_ACTIONS])
    return n_steps * vec.n_envs * group.n / (time.process_time() - began)


def _dictionary_rate(env: Any, seed: int) -> float:
    rng, team = np.random.default_rng(seed), env.possible_agents
    n_actions, n_steps = int(env.action_space(team[0]).n), env.max_cycles
    plays = [dict(zip(team, rng.integers(n_actions, size=len(team)).tolist(), strict=True)) for _ in range(N_ACTIONS)]
    began = time.process_time()
    env.reset(seed=seed)
    for step in range(n_steps):
        env.step(plays[step % N_ACTIONS])
    return n_steps * len(team) / (time.process_time() - began)
