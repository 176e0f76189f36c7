"""The serve command: a run whose cars obey a foreign master."""

from __future__ import annotations

import math
from contextlib import ExitStack
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from fleet.cli.run_output import ALL_DONE, INTERRUPTED, plain_console, run_table, show_next, show_recording
from fleet.config import Fidelity, RunConfig, require
from fleet.config.scenario_file import read_events
from fleet.errors import ConfigError
from fleet.vda5050.dialects import DIALECTS

if TYPE_CHECKING:
    from collections.abc import Callable

    from fleet.gateway.mqtt import BrokerAddress
    from fleet.gateway.transport import Transport
    from fleet.run.events import Event


@dataclass(frozen=True, kw_only=True)
class Serve:
    """Run a fleet whose cars obey a master by VDA 5050 over MQTT; the arms of stations do its picks and drops."""

    vda5050: str
    """Address of the MQTT broker: mqtt://HOST:PORT, or mqtts://HOST:PORT with TLS."""
    broker: bool = False
    """Run a broker at that address, which must be on this machine (127.0.0.1); it lets in whoever is on it."""
    dialect: Annotated[str, tyro.conf.arg(help=f"Version that the master speaks: {', '.join(DIALECTS)}.")] = "2.1.0"
    interface: str = "uagv"
    """First level of the topics."""
    manufacturer: str = "fleet"
    """Manufacturer of the cars; their serial numbers are car_0, car_1, ..."""
    map_id: str | None = None
    """Name of the map that nodes lie on; default the name of the site."""
    user: str | None = None
    """How the broker knows us."""
    password_file: Path | None = None
    """File whose first line is the password of --user."""
    ca: Path | None = None
    """Certificates of those that may vouch for the broker; default those of the system."""
    certificate: Path | None = None
    """Our own certificate, if the broker wants one."""
    key: Path | None = None
    """The key of --certificate."""
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
    fidelity: Fidelity = Fidelity.PHYSICS
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
        from fleet.recording import RECORDING
        from fleet.session import SessionConfig, run_session
        from fleet.vda5050.vehicle import Timing

        self._check()
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
        address = self._address()
        with ExitStack() as stack:
            transport, console = self._transport(address, stack), plain_console()

            def make(config: RunConfig, *, on_event: Callable[[Event], None]) -> MasteredSimulation:
                simulation = MasteredSimulation(config, gateway, transport, on_event=on_event)
                said = f"cars speak VDA 5050 {self.dialect} at {address.url}; Ctrl-C ends the run"
                console.print(said, soft_wrap=True)
                return simulation

            result = run_session(config, session, make)
        console.print(run_table({"value": vars(result)}, short=True))
        if self.record:
            show_recording(console, self.out / RECORDING, view=False)
        show_next(console, self.out)
        for line in result.events_not_happened:
            console.print(f"did not happen: {line}", soft_wrap=True)
        return INTERRUPTED if result.interrupted else ALL_DONE

    def _check(self) -> None:
        """Refuse what only the command line can get wrong."""
        require(math.isfinite(self.speed) and self.speed >= 0, "--speed", self.speed, "a number >= 0")
        shown = math.isfinite(self.visualization) and self.visualization >= 0
        require(shown, "--visualization", self.visualization, "a number >= 0")
        known = self.password_file is None or self.user is not None
        require(known, "--password-file", str(self.password_file), "with --user")
        paired = (self.certificate is None) == (self.key is None)
        require(paired, "--certificate", str(self.certificate), "together with --key")

    def _address(self) -> BrokerAddress:
        password = ""
        if self.password_file is not None:
            password = self.password_file.read_text(encoding="utf-8").partition("\n")[0]
        try:
            from fleet.gateway.mqtt import BrokerAddress
        except ImportError as error:
            raise ConfigError("--vda5050 needs paho-mqtt; valid: pip install 'fleet[vda5050]'") from error
        address = BrokerAddress(
            url=self.vda5050,
            user=self.user or "",
            password=password,
            ca=self.ca,
            certificate=self.certificate,
            key=self.key,
        )
        if self.broker:
            ours = address.host in ("127.0.0.1", "localhost") and not address.tls
            require(
                ours, "--broker", self.vda5050, "with mqtt://127.0.0.1:PORT: ours has no TLS and serves this machine"
            )
        return address

    def _transport(self, address: BrokerAddress, stack: ExitStack) -> Transport:
        """Connections to the broker, which runs as long as the stack is open if it is ours."""
        from fleet.gateway.broker import EmbeddedBroker
        from fleet.gateway.mqtt import MqttTransport

        if self.broker:
            stack.enter_context(EmbeddedBroker(address.port))
        return MqttTransport(address, self.manufacturer)
