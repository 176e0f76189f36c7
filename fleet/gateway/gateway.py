"""Gateway: all cars of a run on the wire."""

from __future__ import annotations

from fleet.gateway.car import CommandedCar
from fleet.gateway.config import GatewayConfig
from fleet.gateway.floor import Floor
from fleet.gateway.transport import Transport
from fleet.run.view import RunView


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
        self._floor = Floor(run, config.map_id or run.site.name)
        self.cars: list[CommandedCar] = []
        try:
            for car in range(run.world.n_cars):
                self.cars.append(CommandedCar(self._floor, car, config, transport))
        except Exception:
            self.close()
            raise

    def tick(self, tick: int, now_s: float) -> None:
        """Hear, go on and speak."""
        self._floor.look()
        for car in self.cars:
            car.tick(tick, now_s)

    def close(self) -> None:
        """Let all cars leave in order."""
        for car in self.cars:
            car.close(self._floor.run.sim_s)
        self.cars.clear()
