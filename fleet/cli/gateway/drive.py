"""The drive command: our fleet manager orders vehicles of others."""

from __future__ import annotations

import math
import time
from contextlib import ExitStack
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING
from uuid import uuid4

from fleet.cli.gateway.connection import Connection
from fleet.cli.run_output import exit_status, plain_console, show_run
from fleet.config import Fidelity, RunConfig, require

if TYPE_CHECKING:
    from collections.abc import Callable

    from fleet.gateway.foreign_simulation import ForeignSimulation
    from fleet.gateway.foreign_vehicles import ForeignVehicles
    from fleet.gateway.transport import Transport
    from fleet.run.events import Event
    from fleet.vda5050.envelope import Identity

LOOK_S = 0.1
"""Time between two looks whether all vehicles have spoken [s]."""
ASK_S = 2.0
"""Time after which one that has not spoken is asked again [s]."""


@dataclass(frozen=True, kw_only=True)
class DriveCommand(Connection):
    """Order vehicles of others by VDA 5050 over MQTT: they drive, our dispatch and planner decide, our arms serve."""

    vehicle: tuple[str, ...] = ()
    """A vehicle, as MANUFACTURER/SERIAL; once for each."""
    patience: float = 30.0
    """How long to wait for the broker, and for the vehicles to say where they stand [s]."""
    site: str = "small"
    """Name of a shipped site (see `site list`) or path of a site file; its lanes are those that the vehicles know."""
    tasks: int | None = None
    """Number of deliveries; default two per vehicle, at least 6."""
    orders: Path | None = None
    """CSV or JSON file of orders instead of generated ones, as for the demo."""
    seed: int = 0
    """Seed of everything random."""
    duration: float = 3600.0
    """End after this much simulated time even if tasks are open [s]."""
    speed: float = 1.0
    """Simulated seconds per second of wall time: as fast as the vehicles' clocks go."""
    out: Path = Path("runs/drive")
    """Directory for recording.rrd, run.jsonl and result.json."""
    record: bool = False
    """Write a recording."""

    def run(self) -> int:
        """Run and print the result; returns the exit status."""
        from fleet.gateway.foreign_simulation import ForeignSimulation
        from fleet.session import SessionConfig, run_session
        from fleet.vda5050.envelope import Identity

        require(math.isfinite(self.speed) and self.speed > 0, "--speed", self.speed, "a number > 0")
        require(math.isfinite(self.patience) and self.patience >= 0, "--patience", self.patience, "a number >= 0")
        require(bool(self.vehicle), "--vehicle", "", "MANUFACTURER/SERIAL, once for each vehicle")
        identities = []
        for name in self.vehicle:
            manufacturer, _, serial = name.partition("/")
            require(bool(serial), "--vehicle", name, "MANUFACTURER/SERIAL")
            identities.append(Identity(interface=self.interface, manufacturer=manufacturer, serial=serial))
        require(len(set(identities)) == len(identities), "--vehicle", identities[-1].serial, "each vehicle once")
        address = self.address()
        config = RunConfig(
            site=self.site,
            robots=len(identities),
            tasks=self.tasks,
            orders=self.orders,
            seed=self.seed,
            duration_s=self.duration,
            fidelity=Fidelity.GRID,
        )
        session = SessionConfig(out=self.out, record=self.record, speed=self.speed)
        with ExitStack() as stack:
            # A broker ends a connection when another one comes with its name, and there may be other masters.
            transport, console = self.transport(address, f"fleet-{uuid4().hex[:8]}", stack), plain_console()
            until = time.monotonic() + self.patience
            vehicles = self._vehicles(identities, transport, until)
            stack.callback(vehicles.close)
            self._find(vehicles, until)

            def make(config: RunConfig, *, on_event: Callable[[Event], None]) -> ForeignSimulation:
                simulation = ForeignSimulation(config, vehicles, map_id=self.map_id or "", on_event=on_event)
                console.print(f"{len(identities)} vehicles at {address.url} are ours to order", soft_wrap=True)
                return simulation

            result = run_session(config, session, make)
            troubles = vehicles.troubles()
        show_run(console, result, self.out, recorded=self.record)
        for trouble in troubles:
            console.print(trouble, soft_wrap=True, markup=False)
        return exit_status(console, result, self.duration)

    @staticmethod
    def _find(vehicles: ForeignVehicles, until: float) -> None:
        """Wait until all vehicles have said where they stand, or there is no more time."""
        asked_s = -math.inf
        while None in vehicles.states and (now_s := time.monotonic()) < until:
            if now_s - asked_s >= ASK_S:
                vehicles.ask(0.0)
                asked_s = now_s
            vehicles.hear()
            time.sleep(LOOK_S)

    def _vehicles(self, identities: list[Identity], transport: Transport, until: float) -> ForeignVehicles:
        """The connection to the vehicles; a broker that is not up yet is waited for, and one that refuses us is not."""
        from fleet.gateway.errors import GatewayError, RefusedError
        from fleet.gateway.foreign_vehicles import ForeignVehicles
        from fleet.vda5050.codec import dialect_named

        while True:
            try:
                return ForeignVehicles(identities, dialect_named(self.dialect), transport, datetime.now(UTC))
            except RefusedError:
                raise
            except GatewayError:
                if time.monotonic() >= until:
                    raise
                time.sleep(LOOK_S)
