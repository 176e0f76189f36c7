"""Traffic by a policy: once a second, a policy of the traffic layer says where the cars go next."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, cast

import numpy as np

from fleet.abstract.fleet import TIMESTEP_S
from fleet.abstract.kernel import NONE
from fleet.envs.policies import make_policy
from fleet.envs.traffic.env import TrafficEnv, TrafficEnvConfig
from fleet.envs.traffic.simulation import AgentTraffic, SimulatedTraffic, TrafficSimulation
from fleet.play.policies import PlayedPolicy
from fleet.simulation import Simulation
from fleet.tasks.order import Delivery

STALL_S = 30.0
"""If no car comes nearer to its goal for so long although one could, the classical part goes on [s]."""
HELP_S = 10.0
"""So long [s]."""
ASK_S = 0.5
"""Time between two questions: a car can choose when one granted move is left to it, and need not wait for the next full
second then [s]."""
CLASSICAL = "pibt"
"""The policy that plays the classical part."""


class PolicyTraffic(AgentTraffic):
    """Moves cars as a policy wishes, and tells observers what any run tells."""

    def tick(self, tick: int) -> bool:
        """See `Traffic`."""
        landed = super().tick(tick)
        if landed:
            self.landed_goals = self.goals.copy()
            self.priorities = self.priority(tick)
        return landed

    def next_plan_tick(self, car: int, tick: int) -> int:
        """See `Traffic`."""
        del car
        return tick + round(TIMESTEP_S / self._tick_s)


class _Fleet(SimulatedTraffic):
    """The fleet of a run whose time passes by itself."""

    def run(self, duration_s: float) -> None:
        """Take the wishes, at once."""
        del duration_s
        self.simulation.traffic.tick(self.simulation.now)

    def close(self) -> None:
        """See `Fleet`: the run is not the environment's."""


class _Env(TrafficEnv):
    """A traffic environment whose one episode is a run that is under way."""

    def __init__(self, config: TrafficEnvConfig, simulation: TrafficSimulation) -> None:
        super().__init__(config)
        self._simulation = simulation

    def look(self) -> dict[str, Any]:
        """What the cars see now."""
        return self._observations()

    def _fleet_of(self, orders: tuple[Delivery, ...], seed: int, duration_s: float) -> SimulatedTraffic:
        del orders, seed, duration_s
        return _Fleet(self._simulation)


class TrafficPlayer:
    """Plays the traffic layer of a run.

    A decision is one of a car that is not where it should be, and can go somewhere. The classical part decides for all
    cars for `HELP_S` when no car has come nearer to its goal for `STALL_S`; an illegal answer is a wait.

    Args:
        simulation: The run, before its first tick; its traffic is a `PolicyTraffic`.
        played: Decides.

    Raises:
        ConfigError: It knows the fleet by a setting that there is not.
        TrainingError: It has learned to see or do something else.
    """

    def __init__(self, simulation: Simulation, played: PlayedPolicy) -> None:
        run = cast(TrafficSimulation, simulation)
        self._simulation = run
        self._policy = played.policy
        self._classical = make_policy("traffic", CLASSICAL, simulation.config.seed)
        self._decisions = played.decisions
        self._env = _Env(traffic_config(simulation, played.settings), run)
        played.require_fits(self._env)
        self._env.reset(seed=simulation.config.seed)
        self._period = round(ASK_S / simulation.tick_s)
        self._goals = run.traffic.goals.copy()
        self._nearest = np.full(len(self._goals), np.iinfo(np.int64).max)  # each car has come to its goal, in moves
        self._progress_s = 0.0
        self._helped_until_s = 0.0

    def tick(self) -> None:
        """Decide, if it is time to."""
        if (self._simulation.now - 1) % self._period:  # goals are given in the first tick
            return
        env, now_s = self._env, self._simulation.sim_s
        seen = env.look()
        cars = zip(env.possible_agents, env.view.priority >= 0.0, strict=True)
        choosing = [agent for agent, goes in cars if goes and seen[agent]["action_mask"][1:].any()]
        if self._has_progress() or not choosing:
            self._progress_s = now_s
        elif now_s - self._progress_s > STALL_S:
            self._progress_s, self._helped_until_s = now_s, now_s + HELP_S
            self._simulation.log("policy_replaced", layer="traffic", cause="nothing moved on")
        helped = now_s < self._helped_until_s
        infos = env.step((self._classical if helped else self._policy).act(env, seen))[4]
        if helped:
            self._decisions.fall_back("nothing moved on", len(choosing))
            return
        illegal = sum(bool(infos[agent]["illegal"]) for agent in choosing)
        if illegal:
            self._decisions.fall_back("illegal", illegal)
        other = sum(bool(infos[agent]["waits"] or infos[agent]["pushed"]) for agent in choosing)
        self._decisions.decide(len(choosing) - illegal, len(choosing) - illegal - other)

    def _has_progress(self) -> bool:
        """Whether a car has a new goal, or is nearer to its goal than it ever was."""
        view, place = self._env.view, self._env.place
        row = np.where(view.goal != NONE, place.goal_row[view.goal], NONE)
        left = np.where(row != NONE, place.floor.distance[row, view.state].astype(np.int64), 0)
        new = view.goal != self._goals
        nearer = new | (left < self._nearest)
        self._goals, self._nearest = view.goal.copy(), np.where(new, left, np.minimum(left, self._nearest))
        return bool(nearer.any())


def traffic_config(simulation: Simulation, settings: Mapping[str, Any]) -> TrafficEnvConfig:
    """Settings under which a policy of the traffic layer sees a run.

    Raises:
        ConfigError: A setting is unknown, or outside its valid range.
    """
    config = simulation.config
    return TrafficEnvConfig.of(
        {
            **settings,
            "site": config.site,
            "n_cars": config.robots,
            "fidelity": str(config.fidelity),
            "max_cycles": round(config.duration_s / ASK_S) + 1,
        }
    )
