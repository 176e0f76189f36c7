"""Settings of the gateway: who the cars are on the wire."""

from __future__ import annotations

from dataclasses import dataclass, field
from datetime import UTC, datetime

from fleet.config import require
from fleet.vda5050.dialects import DIALECTS, Dialect
from fleet.vda5050.envelope import Identity
from fleet.vda5050.vehicle import Timing

EPOCH = datetime(2000, 1, 1, tzinfo=UTC)


@dataclass(frozen=True, kw_only=True)
class GatewayConfig:
    """Who the cars are on the wire.

    Raises:
        ConfigError: There is no such dialect.
        MessageError: A name has signs that topics cannot have.
    """

    dialect: str = "2.1.0"
    """Name in `fleet.vda5050.dialects.DIALECTS`."""
    interface: str = "uagv"
    """First level of the topics."""
    manufacturer: str = "fleet"
    map_id: str = ""
    """Name of the map that nodes lie on; empty = the name of the site."""
    start: datetime = EPOCH
    """The instant of simulated time zero, for headers."""
    timing: Timing = field(default_factory=Timing)

    def __post_init__(self) -> None:
        require(self.dialect in DIALECTS, "--dialect", self.dialect, ", ".join(DIALECTS))
        self.identity(0)

    @property
    def speaks(self) -> Dialect:
        """The dialect."""
        return DIALECTS[self.dialect]

    def identity(self, car: int) -> Identity:
        """Who a car is: its serial number is its name."""
        return Identity(interface=self.interface, manufacturer=self.manufacturer, serial=f"car_{car}")
