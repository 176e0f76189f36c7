"""MasteredSimulation: a run in which a master says where cars go and what is done there."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from fleet.assembly import Parts
from fleet.config import RunConfig, require
from fleet.gateway.config import GatewayConfig
from fleet.gateway.gateway import Gateway
from fleet.gateway.rules import MasteredAdmission, MasteredDispatcher
from fleet.gateway.transport import Transport
from fleet.run.ending import Ending
from fleet.run.events import Event
from fleet.run.setup import RunSetup
from fleet.simulation import Simulation


def require_one_motion(setup: RunSetup) -> None:
    """Refuse fleets of which some drive other ways than others: a node stands for states of one kind of cars.

    Raises:
        ConfigError: They do.
    """
    names = ", ".join(kind.name for kind in setup.scene.cars.kinds)
    require(setup.graph.n_kinds == 1, "models of the cars", names, "models that all steer, or all turn on the spot")


class MasteredSimulation(Simulation):
    """A `Simulation` without orders and without dispatch of its own; it ends when its time is up.

    Planner, executor, arms and worlds are the usual ones: the released nodes of a master are the only goals, and cars
    still drive only as far as the executor grants.

    Args:
        config: Everything that decides the outcome, but for the messages.
        gateway: Who the cars are on the wire.
        transport: Connects them.
        on_event: Called with every event as it happens.
        setup: See `Simulation`.

    Raises:
        GatewayError: The broker cannot be reached.
        ConfigError, SiteError, PlanningError: See `Simulation`.
    """

    def __init__(
        self,
        config: RunConfig,
        gateway: GatewayConfig,
        transport: Transport,
        *,
        on_event: Callable[[Event], None] | None = None,
        setup: RunSetup | None = None,
    ) -> None:
        parts = Parts(orders=(), dispatcher=MasteredDispatcher, admission=MasteredAdmission)
        config = replace(config, orders=None)
        setup = setup or RunSetup.of(config)
        require_one_motion(setup)
        self.gateway: Gateway | None = None
        super().__init__(config, on_event=on_event, setup=setup, parts=parts)
        try:
            self.gateway = Gateway(self.view, gateway, transport)
        except Exception:
            self.close()
            raise
        dispatcher = self.dispatcher
        if not isinstance(dispatcher, MasteredDispatcher):
            raise AssertionError("a mastered run has a mastered dispatcher")
        dispatcher.commander = self.gateway

    @property
    def ending(self) -> Ending | None:
        """See `Simulation`; that there is nothing to do ends nothing, as a master may send more."""
        return Ending.TIME_UP if self.sim_s >= self.config.duration_s else None

    def close(self) -> None:
        """Let the cars leave in order; see `Simulation`."""
        if self.gateway is not None:
            self.gateway.close()
        super().close()
