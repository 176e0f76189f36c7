"""Dispatch by a policy: whenever the fleet gives out tasks, a policy of the dispatch layer is asked."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from fleet.abstract.fleet import FleetSite
from fleet.dispatch.allocation import Choice
from fleet.dispatch.situation import Situation
from fleet.envs.dispatch.env import DispatchConfig, DispatchEnv
from fleet.envs.dispatch.simulation import AgentAllocation, SimulatedDispatch
from fleet.envs.policies import make_policy
from fleet.play.policies import PlayedPolicy
from fleet.simulation import Simulation
from fleet.tasks.order import Delivery

PATIENCE_S = 30.0
"""A car that took nothing for so long although tasks were on offer is given one by the classical part [s]."""
CLASSICAL = "hungarian"
"""The policy that plays the classical part."""


class PolicyAllocation(AgentAllocation):
    """Asks a policy whenever tasks are to be given out."""

    ask: Callable[[], None] | None = None
    """Lets the policy choose for the cars that are free now."""

    def choose(self, situation: Situation, now_s: float) -> Choice:
        """See `TaskAllocation`."""
        if self.ask is not None:
            self.ask()
        return super().choose(situation, now_s)


class _Fleet(SimulatedDispatch):
    """The fleet of a run whose time passes by itself."""

    def give(self, pairs: Sequence[tuple[int, int]]) -> None:
        """See `DispatchFleet`; the tasks are given out at once, by the allocation that has asked."""
        allocation, tasks = self.simulation.view.assignments.allocation, self.simulation.board.tasks
        if isinstance(allocation, AgentAllocation):
            allocation.chosen = [(car, tasks[task]) for car, task in pairs]

    def run(self, duration_s: float) -> None:
        """See `DispatchFleet`."""

    def close(self) -> None:
        """See `Fleet`: the run is not the environment's."""


class _Env(DispatchEnv):
    """A dispatch environment whose one episode is a run that is under way."""

    def __init__(self, config: DispatchConfig, simulation: Simulation) -> None:
        super().__init__(config)
        self._simulation = simulation

    def look(self) -> dict[str, Any]:
        """What the cars see now; of the episode has passed what has passed of the run, however often they are asked."""
        self.n_steps = min(int(self._simulation.sim_s / self.config.step_s), self.max_cycles - 2)
        return self._observations()

    def _fleet_of(self, orders: tuple[Delivery, ...], seed: int, duration_s: float) -> _Fleet:
        del orders, seed, duration_s
        place: FleetSite = self.place
        self._idle_steps[:] = 0
        return _Fleet(place, self._simulation)


class DispatchPlayer:
    """Plays the dispatch layer of a run.

    A decision is one of a free car that has a task to choose. The classical part decides for cars whose policy gives an
    illegal answer, which take nothing until they are asked again, and for cars that have taken nothing for
    `PATIENCE_S`.

    Args:
        simulation: The run, before its first tick; its allocation is a `PolicyAllocation`.
        played: Decides.

    Raises:
        ConfigError: It knows the fleet by a setting that there is not.
        TrainingError: It has learned to see or do something else.
    """

    def __init__(self, simulation: Simulation, played: PlayedPolicy) -> None:
        config = dispatch_config(simulation, played.settings)
        self._simulation = simulation
        self._policy = played.policy
        self._classical = make_policy("dispatch", CLASSICAL)
        self._decisions = played.decisions
        self._env = _Env(config, simulation)
        played.require_fits(self._env)
        self._env.reset(seed=simulation.config.seed)
        self._since_s = np.full(config.n_cars, np.inf)  # when each car was first offered what it has not taken
        allocation = simulation.view.assignments.allocation
        if isinstance(allocation, PolicyAllocation):
            allocation.ask = self.ask

    def tick(self) -> None:
        """Nothing: the policy is asked when tasks are given out."""

    def ask(self) -> None:
        """Let the policy choose for all free cars."""
        env, now_s = self._env, self._simulation.sim_s
        seen = env.look()
        choosing = [agent for agent, one in seen.items() if one["action_mask"][1:].any()]
        actions = self._policy.act(env, seen)
        cars = [env.possible_agents.index(agent) for agent in choosing]
        offered = np.full(len(self._since_s), np.inf)
        offered[cars] = np.minimum(self._since_s[cars], now_s)
        self._since_s = offered
        late = [agent for agent, car in zip(choosing, cars, strict=True) if now_s - offered[car] > PATIENCE_S]
        if late:
            classical = self._classical.act(env, seen)
            actions = {**actions, **{agent: classical[agent] for agent in late}}
            self._decisions.fall_back("took nothing for too long", len(late))
            for agent in late:
                self._simulation.log("policy_replaced", layer="dispatch", car=agent, cause="took nothing for too long")
        infos = env.step(actions)[4]
        own = [agent for agent in choosing if agent not in late]
        illegal = sum(bool(infos[agent]["illegal"]) for agent in own)
        if illegal:
            self._decisions.fall_back("illegal", illegal)
        lost = sum(bool(infos[agent]["waits"]) for agent in own)
        if lost:
            self._simulation.missions.changed = True  # who did not get its task is asked again soon
        self._decisions.decide(len(own) - illegal, len(own) - illegal - lost)


def dispatch_config(simulation: Simulation, settings: Mapping[str, Any]) -> DispatchConfig:
    """Settings under which a policy of the dispatch layer sees a run.

    Raises:
        ConfigError: A setting is unknown, or outside its valid range.
    """
    config = simulation.config
    decision_s = float(settings.get("decision_s", DispatchConfig.decision_s))
    of_run = {"site": config.site, "n_cars": config.robots, "fidelity": str(config.fidelity)}
    # An episode is a step longer than the run, which tells the policy how much is left, and ends the episode.
    return DispatchConfig.of({**settings, **of_run, "max_cycles": max(1, round(config.duration_s / decision_s)) + 1})
