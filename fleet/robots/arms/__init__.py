"""Arms that can be named; a new one is one file here and one line in `ARMS`."""

from __future__ import annotations

from importlib import import_module

from fleet.errors import ConfigError
from fleet.robots.arms.iiwa import IIWA
from fleet.robots.arms.kind import ArmKind
from fleet.robots.arms.panda import PANDA
from fleet.robots.arms.xarm import XARM
from maps.reading.near import hint

ARMS: dict[str, ArmKind] = {
    "iiwa": IIWA,
    "panda": PANDA,
    "xarm": XARM,
}


def arm_kind(name: str, where: str = "arm") -> ArmKind:
    """Look up an arm.

    Args:
        name: A key of `ARMS`, or for an arm that stands elsewhere `package.module.NAME`.
        where: What has named it, opens the message.

    Raises:
        ConfigError: There is no such arm.
    """
    if name in ARMS:
        return ARMS[name]
    valid = f"{', '.join(ARMS)} or package.module.NAME"
    module, _, member = name.rpartition(".")
    if not (module and member):
        raise ConfigError(f"{where} is {name!r}{hint(name, ARMS)}; valid: {valid}")
    try:
        found = getattr(import_module(module), member)
    except Exception as error:  # whatever a module of one's own does wrong is told in one line
        raise ConfigError(f"{where} is {name!r}: {type(error).__name__}: {error}; valid: {valid}") from error
    if not isinstance(found, ArmKind):
        raise ConfigError(f"{where} is {name!r}, which is no ArmKind; valid: {valid}")
    return found
