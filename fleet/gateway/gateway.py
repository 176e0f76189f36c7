"""Gateway: all cars of a run on the wire."""

from __future__ import annotations

from fleet.gateway.car import CommandedCar
from fleet.gateway.config import GatewayConfig
from fleet.gateway.node_map import NodeMap
from fleet.gateway.transport import Transport
from fleet.run.view import RunView

LOOK_S = 1.0
"""Time between two looks at who stands in the way of others [s]."""


class Gateway:
    """The cars of a run, each with a connection of its own, so that each has its own last will.

    Args:
        run: The run; its cars get no goals from anybody else.
        config: Who they are on the wire.
        transport: Connects them.

    Raises:
        GatewayError: The broker cannot be reached.
    """

    def __init__(self, run: RunView, config: GatewayConfig, transport: Transport) -> None:
        self._nodes = NodeMap(run, config.map_id or run.site.name)
        self._look_ticks = max(1, round(LOOK_S / run.tick_s))
        self.cars: list[CommandedCar] = []
        try:
            for car in range(run.world.n_cars):
                self.cars.append(CommandedCar(self._nodes, car, config, transport))
        except Exception:
            self.close()
            raise

    def tick(self, tick: int, now_s: float) -> None:
        """Hear, go on and speak."""
        self._nodes.look()
        for car in self.cars:
            car.tick(tick, now_s)
        if tick % self._look_ticks == 0:
            run = self._nodes.run
            standing = [number for number, car in enumerate(self.cars) if car.stands]
            run.traffic.go_round(run.graph.state_cell[self._nodes.granted[standing]])

    def close(self) -> None:
        """Let all cars leave in order."""
        for car in self.cars:
            car.close(self._nodes.run.sim_s)
        self.cars.clear()
