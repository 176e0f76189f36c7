"""The serve command: a run whose cars obey a foreign master."""

from __future__ import annotations

import math
from contextlib import ExitStack
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING

from fleet.cli.gateway.connection import Connection
from fleet.cli.run_output import ALL_DONE, INTERRUPTED, plain_console, show_run
from fleet.config import Fidelity, RunConfig, WholeFidelity, require
from fleet.config.scenario_file import read_events

if TYPE_CHECKING:
    from collections.abc import Callable

    from fleet.run.events import Event


@dataclass(frozen=True, kw_only=True)
class Serve(Connection):
    """Run a fleet whose cars obey a master by VDA 5050 over MQTT; the arms of stations do its picks and drops."""

    manufacturer: str = "fleet"
    """Manufacturer of the cars; their serial numbers are car_0, car_1, ..."""
    visualization: float = 1.0
    """Time between two visualization messages of a car [s]; 0 = none."""
    site: str = "small"
    """Name of a shipped site (see `site list`) or path of a site file."""
    robots: int = 3
    """Number of cars."""
    seed: int = 0
    """Seed of everything random."""
    events: Path | None = None
    """TOML file of disturbances, as for the demo."""
    fidelity: WholeFidelity = Fidelity.PHYSICS
    """How robots are moved."""
    duration: float = 3600.0
    """End after this much simulated time; Ctrl-C ends a run, too [s]."""
    speed: float = 1.0
    """Simulated seconds per second of wall time; 0 = as fast as possible. Masters go by the wall clock: 1."""
    out: Path = Path("runs/serve")
    """Directory for recording.rrd, run.jsonl and result.json."""
    record: bool = False
    """Write a recording."""
    check: bool = False
    """Check after every tick that the run is safe and its books are right; end it at the first violation."""

    def run(self) -> int:
        """Run and print the result; returns the exit status."""
        from fleet.gateway import GatewayConfig, MasteredSimulation
        from fleet.session import SessionConfig, run_session
        from fleet.vda5050.vehicle import Timing

        self._check()
        address = self.address()
        config = RunConfig(
            site=self.site,
            robots=self.robots,
            seed=self.seed,
            events=read_events(self.events) if self.events else (),
            fidelity=self.fidelity,
            duration_s=self.duration,
        )
        gateway = GatewayConfig(
            dialect=self.dialect,
            interface=self.interface,
            manufacturer=self.manufacturer,
            map_id=self.map_id or "",
            start=datetime.now(UTC),
            timing=Timing(visualization_s=self.visualization or math.inf),
        )
        session = SessionConfig(out=self.out, record=self.record, speed=self.speed, check=self.check)
        with ExitStack() as stack:
            transport, console = self.transport(address, self.manufacturer, stack), plain_console()

            def make(config: RunConfig, *, on_event: Callable[[Event], None]) -> MasteredSimulation:
                simulation = MasteredSimulation(config, gateway, transport, on_event=on_event)
                said = f"cars speak VDA 5050 {self.dialect} at {address.url}; Ctrl-C ends the run"
                console.print(said, soft_wrap=True)
                return simulation

            result = run_session(config, session, make)
        show_run(console, result, self.out, recorded=self.record)
        return INTERRUPTED if result.interrupted else ALL_DONE

    def _check(self) -> None:
        """Refuse what only the command line can get wrong."""
        require(math.isfinite(self.speed) and self.speed >= 0, "--speed", self.speed, "a number >= 0")
        shown = math.isfinite(self.visualization) and self.visualization >= 0
        require(shown, "--visualization", self.visualization, "a number >= 0")
