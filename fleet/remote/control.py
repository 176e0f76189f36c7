"""RemoteControl: what somebody outside of the fleet may do to a run: drive cars, move arms, give orders."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from fleet.arrays import FloatArray
from fleet.incidents.recovery import Recovery
from fleet.remote.arms import RemoteArms
from fleet.remote.cars import RemoteCars
from fleet.remote.errors import RemoteError
from fleet.run.view import RunView
from fleet.tasks.order_file import OrderTerms, read_order

DEFAULT_KG, DEFAULT_EDGE_M = 0.3, 0.06
"""Parcel of a delivery of which nothing else is said."""


class RemoteControl:
    """The hands from outside on a run; what they do stands in its events.

    Args:
        run: The run.
        recovery: Takes cars off their lanes, and brings them back.
        terms: What orders have to fit.
    """

    def __init__(self, run: RunView, recovery: Recovery, terms: OrderTerms) -> None:
        self._run = run
        self._terms = terms
        self._n_orders = 0
        self.cars = RemoteCars(run, recovery)
        self.arms = RemoteArms(run)

    def tick(self, commands: FloatArray) -> None:
        """Let robots in other hands do what they are told, instead of what the fleet commands, shape (n_cars, 2)."""
        self.cars.tick(commands)
        self.arms.tick()

    def order(self, fields: Mapping[str, object]) -> str:
        """Take in an order; it is released at once.

        Args:
            fields: Entries as in an orders file; without `id` it gets a name, and a delivery may leave out its parcel.

        Returns:
            Its name.

        Raises:
            OrdersError: It cannot be accepted; names field, value and valid values.
            NameTaken: Another order has its name.
        """
        self._n_orders += 1
        usual: dict[str, object] = {"id": f"remote_{self._n_orders}"}
        if fields.get("type", "delivery") == "delivery":
            usual |= {"mass_kg": DEFAULT_KG, "size_m": DEFAULT_EDGE_M}
        task = self._run.board.add(read_order({**usual, **fields, "release_s": self._run.sim_s}, self._terms))
        self._run.events.log("remote_order", task=task.order.name)
        return task.order.name

    def send(self, car: int, x_m: float, y_m: float) -> str:
        """Order a car of the fleet to a place, by the fleet's own ways.

        Args:
            car: The car.
            x_m: Where it is to stand; the middle of the cell with a lane that is there counts.
            y_m: The same along y.

        Returns:
            Name of the order.

        Raises:
            RemoteError: The car is in other hands, or these are no numbers.
            OrdersError: There is no lane.
            NameTaken: Another order has its name.
        """
        if car in self.cars.taken:
            raise RemoteError(f"car_{car} is in other hands; valid: a car that the fleet drives")
        if not (math.isfinite(x_m) and math.isfinite(y_m)):
            raise RemoteError(f"car_{car}: goal {x_m}, {y_m}; valid: finite numbers")
        grid = self._run.site.grid
        row, col = grid.rows - 1 - math.floor(y_m / grid.cell_m), math.floor(x_m / grid.cell_m)
        place = f"{np.clip(row, 0, grid.rows - 1)},{np.clip(col, 0, grid.cols - 1)}"
        return self.order({"type": "move", "places": place, "needs": f"car_{car}", "priority": "emergency"})
