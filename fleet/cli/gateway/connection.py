"""Connection: the options of commands that speak VDA 5050 with somebody."""

from __future__ import annotations

from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from fleet.config import require
from fleet.errors import ConfigError
from fleet.vda5050.dialects import DIALECTS

if TYPE_CHECKING:
    from fleet.gateway.mqtt import BrokerAddress
    from fleet.gateway.transport import Transport


@dataclass(frozen=True, kw_only=True)
class Connection:
    """How to come to the broker, and what is spoken there."""

    vda5050: str
    """Address of the MQTT broker: mqtt://HOST:PORT, or mqtts://HOST:PORT with TLS."""
    broker: bool = False
    """Run a broker at that address, which must be on this machine (127.0.0.1); it lets in whoever is on it."""
    dialect: Annotated[str, tyro.conf.arg(help=f"Version that the master speaks: {', '.join(DIALECTS)}.")] = "2.1.0"
    interface: str = "uagv"
    """First level of the topics."""
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

    def address(self) -> BrokerAddress:
        """Where the broker is, and how it knows us.

        Raises:
            ConfigError: Options do not go together, or the extra is missing.
            GatewayError: The address or a file is none.
        """
        require(self.dialect in DIALECTS, "--dialect", self.dialect, ", ".join(DIALECTS))
        known = self.password_file is None or self.user is not None
        require(known, "--password-file", str(self.password_file), "with --user")
        paired = (self.certificate is None) == (self.key is None)
        require(paired, "--certificate", str(self.certificate), "together with --key")
        password = ""
        if self.password_file is not None:
            password = _first_line(self.password_file)
            valid = "a file whose first line is the password of --user"
            require(bool(password), "--password-file", str(self.password_file), valid)
        try:
            from fleet.gateway.mqtt import BrokerAddress
        except ImportError as error:
            raise ConfigError("--vda5050 needs paho-mqtt; valid: pip install '.[vda5050]'") from error
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

    def transport(self, address: BrokerAddress, name: str, stack: ExitStack) -> Transport:
        """Connections to the broker, which runs as long as the stack is open if it is ours.

        Args:
            address: The broker.
            name: Begins the names of our clients.
            stack: Ends a broker of ours.

        Raises:
            GatewayError: A broker of ours cannot listen there.
        """
        from fleet.gateway.broker import EmbeddedBroker
        from fleet.gateway.mqtt import MqttTransport

        if self.broker:
            stack.enter_context(EmbeddedBroker(address.port))
        return MqttTransport(address, name)


def _first_line(file: Path) -> str:
    """First line of a file; raises `ConfigError` if it is no text."""
    try:
        return file.read_text(encoding="utf-8").partition("\n")[0]
    except UnicodeDecodeError as error:
        valid = "a text in UTF-8 whose first line is the password of --user"
        raise ConfigError(f"--password-file is {str(file)!r}, which is no text; valid: {valid}") from error
