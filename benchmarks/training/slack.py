"""Slack: how long cars stand at their docks while an arm is at work on them, and how much of that the arm could do in.

A hand-over goes on from the moment a service begins, a car standing at its dock, to the moment the parcel was judged
and the car may leave. In every step of it the arm is at its limits, below them, or stands. It is at its limits when
some joint has at least `AT_LIMIT` of the velocity or of the acceleration that plans may have. The rest is the slack:
what a policy could win that is no faster than plans may be.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from benchmarks.harness import Kind, Row, Trial
from fleet.envs import warehouse_v1
from fleet.envs.policies.policy import Policy
from fleet.envs.policies.warehouse import Classical
from fleet.envs.warehouse.env import WarehouseEnv
from fleet.robots.arms.spec import ArmSpec
from fleet.stations.arms.arm_controller import ArmController
from fleet.tasks.board import TaskState
from fleet.training.recipes.warehouse import handovers_s
from planners.motion.path.trajectory import Trajectory

AT_LIMIT = 0.95
"""Share of a joint's limit from which on an arm is at its limits."""
STEPS = ("out", "down", "grip", "up", "over", "set down", "let go", "rise", "rise", "home")
"""Steps of the plan of a transfer, in their order; in `rise` the parcel comes to rest, and is judged."""
OTHER, BEFORE = "other", "before"
"""Plans of other steps, such as a way home after a failure; and what is left of the plan before this one."""
LIMITS, BELOW, STANDS = "at limits", "below", "stands"
SITE: Mapping[str, Any] = {
    "site": "small",
    "n_cars": 4,
    "tasks": 24,
    "car_action": "residual",
    "arm_action": "residual",
}
"""Where it is measured: cars are never out of work."""
FIRST_SEED = 5000
"""Of the episodes, which no recipe is trained on."""


@dataclass
class Slack:
    """What was found in some episodes."""

    handovers_s: list[float] = field(default_factory=list)
    """How long each hand-over took [s]."""
    spent_s: dict[tuple[str, str], float] = field(default_factory=dict)
    """By step of the plan, and by what the arm did: time, in all hand-overs [s]."""
    deliveries: int = 0
    contacts: int = 0

    @property
    def handover_s(self) -> float:
        """Mean of a hand-over [s]."""
        return float(np.mean(self.handovers_s)) if self.handovers_s else float("nan")

    @property
    def slack_s(self) -> float:
        """Mean of a hand-over's time in which the arm was not at its limits [s]."""
        return self.handover_s * (1.0 - self.share(LIMITS))

    def share(self, doing: str | None = None, step: str | None = None) -> float:
        """Share of the time of all hand-overs, by what the arm did, by step of the plan, or by both."""
        found = sum(spent for (at, did), spent in self.spent_s.items() if doing in (None, did) and step in (None, at))
        return found / max(sum(self.spent_s.values()), 1e-9)


def measure_slack(trial: Trial) -> Iterator[Row]:
    """Hand-overs of the script, and what they are made of."""
    n_episodes = 1 if trial.quick else 10
    for fidelity in ("kinematic", "physics"):
        env = warehouse_v1.parallel_env(**SITE, fidelity=fidelity, max_cycles=300 if trial.quick else 1200)
        found = watch(env, Classical(), range(FIRST_SEED, FIRST_SEED + n_episodes))
        env.close()
        trial.check(len(found.handovers_s) > 0, f"{fidelity}: no hand-over in {n_episodes} episodes")
        name = f"hand-over, {fidelity}"
        yield Row(
            name=name, value=found.handover_s, unit=f"s simulated; {len(found.handovers_s)} of them", kind=Kind.PLAIN
        )
        for doing in (LIMITS, BELOW, STANDS):
            yield Row(name=f"  {doing}", value=100.0 * found.share(doing), unit="%")
        yield Row(name="  slack", value=found.slack_s, unit="s simulated", kind=Kind.PLAIN)
        for step in (BEFORE, *dict.fromkeys(STEPS), OTHER):
            share, slack = found.share(step=step), found.share(step=step) - found.share(LIMITS, step)
            if share > 0.0:
                unit = f"s simulated; of it slack: {found.handover_s * slack:.2f}"
                yield Row(name=f"  {step}", value=found.handover_s * share, unit=unit, kind=Kind.PLAIN)


def watch(env: WarehouseEnv, policy: Policy, seeds: Sequence[int]) -> Slack:
    """Play episodes and look at every hand-over, once a step.

    Args:
        env: Its arms add to the classical plans.
        policy: Decides for all agents.
        seeds: Of the episodes.
    """
    found, step_s = Slack(), env.config.step_s
    for seed in seeds:
        observations, _ = env.reset(seed=seed)
        while env.agents:
            observations, *_ = env.step(policy.act(env, observations))
            for key in _now(env):
                found.spent_s[key] = found.spent_s.get(key, 0.0) + step_s
        simulation = env.simulation
        found.handovers_s += handovers_s(env)
        found.deliveries += sum(task.done_s is not None for task in simulation.board.tasks)
        contacts = simulation.world.contacts()
        found.contacts += contacts.robot + contacts.static
    return found


def _now(env: WarehouseEnv) -> Iterator[tuple[str, str]]:
    """Step of the plan and what the arm does, of every hand-over that goes on."""
    simulation, plans = env.simulation, env.plans
    assert plans is not None
    for arm in range(simulation.n_arms):
        transfer = simulation.arm_manager.transfer(arm)
        if transfer is None:
            continue
        task = simulation.board.tasks[transfer.parcel]
        if task.state in (TaskState.LOADING, TaskState.UNLOADING):
            player = plans.player(arm)
            ours = plans.asked(arm) is transfer
            yield (step_of(player) if ours else BEFORE), doing(player, simulation.scene.arms.specs[0])


def step_of(player: ArmController) -> str:
    """Name of the step of the plan that an arm is at."""
    at, n = player.at
    return STEPS[min(at, n - 1)] if n == len(STEPS) else OTHER


def doing(player: ArmController, arm: ArmSpec) -> str:
    """Whether an arm is at its limits, moves below them, or stands."""
    motion = player.under_way
    if motion is None or player.paused:
        return STANDS
    speed, push = strain(motion, player.done_s, arm)
    return LIMITS if max(speed * player.speed, push * player.speed**2) >= AT_LIMIT else BELOW


def strain(motion: Trajectory, at_s: float, arm: ArmSpec) -> tuple[float, float]:
    """Greatest shares of the joints' limits at a time of a motion, of velocities and of accelerations.

    Args:
        motion: Played at its own pace.
        at_s: Time since its start [s].
        arm: Whose limits they are.
    """
    if len(motion.t) == 1:
        return 0.0, 0.0
    dt = float(motion.t[1])
    k = min(int(at_s / dt), len(motion.t) - 2)
    speed = np.abs(motion.qd[k : k + 2]).max(axis=0) / arm.max_velocity_radps
    push = np.abs(motion.qd[k + 1] - motion.qd[k]) / dt / arm.max_acceleration_radps2
    return float(speed.max()), float(push.max())
