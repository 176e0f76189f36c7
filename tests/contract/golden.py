"""Golden observations: what agents see in short episodes of every environment at every fidelity, as numbers in a file.

An observation whose meaning has changed, by a follower that was dropped or a sign that was turned, trains as well as
before and makes what was learned worthless; only numbers that were kept show it. `python -m tests.contract.golden`
writes the file anew, and the difference belongs into the review of whatever changed it.
"""

from __future__ import annotations

import importlib
import json
import sys
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from gymnasium.spaces import Discrete

from fleet.envs.kuka_reach import KukaReachEnv
from fleet.envs.navigate.car_navigate import CarNavigateEnv
from fleet.training.batch import type_of
from fleet.training.solo import SoloEnv

FILE = Path(__file__).resolve().parents[1] / "data" / "golden_observations.json"
DIGITS = 4
"""Decimals that are kept: last bits differ from machine to machine."""
SEED = 1234
PLAYED, PLAYED_BY_BODIES = 40, 12
"""Steps of an episode; fewer where bodies touch, which makes large differences of small ones."""


@dataclass(frozen=True, kw_only=True)
class GoldenCase:
    """An environment of which observations are kept."""

    env: str
    """Module in `fleet.envs`, or the name of a single robot's environment."""
    arguments: Mapping[str, Any]

    @property
    def name(self) -> str:
        """As the file calls it."""
        told = (f"{key}={value}" for key, value in self.arguments.items())
        return " ".join((self.env, *told))

    def make(self) -> Any:
        """Make the environment."""
        if self.env in SOLO:
            kind, agent = SOLO[self.env]
            return SoloEnv(kind(**self.arguments), agent, self.env)
        return importlib.import_module(f"fleet.envs.{self.env}").parallel_env(**self.arguments)


SOLO: dict[str, tuple[Any, str]] = {"KukaReach": (KukaReachEnv, "arm_0"), "CarNavigate": (CarNavigateEnv, "car_0")}
"""Environments of single robots, with the name of their agent."""
ALL, BODIES = ("grid", "kinematic", "physics"), ("kinematic", "physics")
VARIANTS: dict[str, tuple[tuple[str, ...], tuple[dict[str, Any], ...]]] = {
    "dispatch_v1": (ALL, ({"site": "small", "n_cars": 4, "decision_s": 1.0},)),
    "traffic_v1": (ALL, ({"site": "small", "n_cars": 4},)),
    "navigate_v1": (BODIES, ({"site": "small", "n_cars": 3},)),
    "warehouse_v1": (
        BODIES,
        (
            {"site": "cell", "n_cars": 2},
            {"level": "pair", "arm_action": "tip"},
            {"level": "transfer"},
            {"level": "dock"},
        ),
    ),
    "handover_v0": (BODIES, ({"n_cars": 3, "late_s": 2.0},)),
    "KukaReach": (BODIES, ({},)),
    "CarNavigate": (BODIES, ({},)),
}
"""By environment: its fidelities, and the arguments with each of which it is played."""
CASES = [
    GoldenCase(env=env, arguments={"fidelity": fidelity, **arguments})
    for env, (fidelities, variants) in VARIANTS.items()
    for fidelity in fidelities
    for arguments in variants
]


def seen(case: GoldenCase) -> dict[str, list[float]]:
    """What the first and the last agent of each type see at the beginning and at the end of an episode, rounded.

    Actions are drawn among the legal ones, or swing to and fro.
    """
    env, rng = case.make(), np.random.default_rng(SEED)
    n_steps = PLAYED_BY_BODIES if case.arguments["fidelity"] == "physics" else PLAYED
    observations, _ = env.reset(seed=SEED)
    told = dict(_rows(0, observations))
    for step in range(n_steps):
        observations, *_ = env.step(
            {agent: _action(env, agent, observations[agent], step, rng) for agent in env.agents}
        )
        if not env.agents:
            break
    told |= _rows(n_steps, observations)
    env.close()
    return told


def differences(was: Mapping[str, list[float]], now: Mapping[str, list[float]]) -> list[str]:
    """What has changed, in words; nothing if all is as it was but for last bits."""
    if list(was) != list(now):
        return [f"agents were {', '.join(was)} and are {', '.join(now)}"]
    found = []
    for name, before in was.items():
        after = now[name]
        if len(before) != len(after):
            found.append(f"{name}: {len(before)} numbers have become {len(after)}")
            continue
        changed = np.flatnonzero(np.abs(np.subtract(before, after)) > 1.5 * 10.0**-DIGITS).tolist()
        found += [f"{name}: entry {k} was {before[k]} and is {after[k]}" for k in changed[:5]]
        found += [f"{name}: {len(changed) - 5} entries more"] if len(changed) > 5 else []
    return found


def read() -> dict[str, dict[str, list[float]]]:
    """What is kept, by name of the case."""
    told: dict[str, dict[str, list[float]]] = json.loads(FILE.read_text(encoding="utf-8"))
    return told


def _rows(step: int, observations: Mapping[str, Any]) -> Iterator[tuple[str, list[float]]]:
    by_type: dict[str, list[str]] = {}
    for agent in observations:
        by_type.setdefault(type_of(agent), []).append(agent)
    for agents in by_type.values():
        for agent in dict.fromkeys((agents[0], agents[-1])):
            what = observations[agent]
            parts = [what[key] for key in what if key != "image"] if isinstance(what, Mapping) else [what]
            row = np.concatenate([np.asarray(part, dtype=np.float64).ravel() for part in parts])
            yield f"{agent}, step {step}", [round(value, DIGITS) + 0.0 for value in row.tolist()]


def _action(env: Any, agent: str, what: Any, step: int, rng: np.random.Generator) -> Any:
    space = env.action_space(agent)
    if isinstance(space, Discrete):
        return int(rng.choice(np.flatnonzero(what["action_mask"])))
    entries = np.arange(space.shape[0])
    return (0.4 * np.sin(0.3 * step + entries)).astype(np.float32)


def main() -> None:
    """Write the file anew."""
    told = {case.name: seen(case) for case in CASES}
    lines = []
    for name, rows in told.items():
        inner = ",\n".join(f"  {json.dumps(agent)}: {json.dumps(row)}" for agent, row in rows.items())
        lines.append(f"{json.dumps(name)}: {{\n{inner}\n}}")
    FILE.write_text("{\n" + ",\n".join(lines) + "\n}\n", encoding="utf-8")
    sys.stdout.write(f"{FILE}: {len(told)} cases\n")


if __name__ == "__main__":
    main()
