"""PlayedSimulation: a run in which policies take the place of parts of the fleet, under the executor's grants."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Protocol

from fleet.assembly import Parts, usual_driver
from fleet.config import RunConfig
from fleet.dispatch.allocation import TaskAllocation
from fleet.play.dispatch import DispatchPlayer, PolicyAllocation
from fleet.play.docking import DockingPlayer, docking_driver
from fleet.play.policies import PlayedPolicy
from fleet.play.traffic import PolicyTraffic, TrafficPlayer
from fleet.run.events import Event
from fleet.simulation import Actions, Simulation
from fleet.traffic.replanning import Traffic


class PartPlayer(Protocol):
    """Lets a policy play one layer."""

    def tick(self) -> None:
        """Decide what is to be decided before the next tick."""


class PlayedSimulation(Simulation):
    """A `Simulation` some of whose parts are policies; the others are the classical ones.

    What policies decide goes through the dependency graph like any plan: a car enters only what it was granted.

    Args:
        config: Everything that decides the outcome.
        policies: Who decides, by part: a name in `PLAYERS`.
        on_event: Called with every event as it happens.

    Raises:
        ConfigError: See `Simulation`; or a policy knows the fleet by a setting that there is not.
        TrainingError: A policy has learned to see or do something else.
    """

    def __init__(
        self,
        config: RunConfig,
        policies: Mapping[str, PlayedPolicy],
        *,
        on_event: Callable[[Event], None] | None = None,
    ) -> None:
        parts = Parts(
            traffic=PolicyTraffic if "traffic" in policies else Traffic,
            allocation=PolicyAllocation if "dispatch" in policies else TaskAllocation,
            driver=docking_driver if "docking" in policies else usual_driver,
        )
        self.n_cars, self.n_arms = config.robots, 0
        """Robots that observers of the warehouse layer look at."""
        super().__init__(config, on_event=on_event, parts=parts)
        self._players: list[PartPlayer] = [PLAYERS[part](self, played) for part, played in policies.items()]

    def tick(self, actions: Actions | None = None) -> None:
        """See `Simulation`."""
        if self.now > 0:
            for player in self._players:
                player.tick()
        super().tick(actions)


PLAYERS: dict[str, Callable[[Simulation, PlayedPolicy], PartPlayer]] = {
    "dispatch": DispatchPlayer,
    "traffic": TrafficPlayer,
    "docking": DockingPlayer,
}
"""Who plays each part."""
