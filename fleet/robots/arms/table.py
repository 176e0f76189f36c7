"""ArmTable: arms by name, each loaded when it is first asked for."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from importlib import import_module

from fleet.errors import ConfigError
from fleet.robots.arms.kind import ArmKind
from maps.reading.near import hint


class ArmTable(Mapping[str, ArmKind]):
    """Arms that can be named.

    Args:
        members: Name -> `package.module.NAME` of an `ArmKind`.
    """

    def __init__(self, members: Mapping[str, str]) -> None:
        self._members = dict(members)

    def __getitem__(self, name: str) -> ArmKind:
        return self._found(self._members[name])

    def __iter__(self) -> Iterator[str]:
        return iter(self._members)

    def __len__(self) -> int:
        return len(self._members)

    @property
    def valid(self) -> str:
        """What can be named, in words."""
        return f"{', '.join(self)} or package.module.NAME"

    def named(self, name: str, where: str = "arm") -> ArmKind:
        """Look up an arm.

        Args:
            name: A name of the table, or for an arm that stands elsewhere `package.module.NAME`.
            where: What has named it, opens the message.

        Raises:
            ConfigError: There is no such arm.
        """
        if name in self._members:
            return self[name]
        if not all(name.rpartition(".")):
            raise ConfigError(f"{where} is {name!r}{hint(name, self)}; valid: {self.valid}")
        try:
            return self._found(name)
        except Exception as error:  # whatever a module of one's own does wrong is told in one line
            raise ConfigError(f"{where} is {name!r}: {type(error).__name__}: {error}; valid: {self.valid}") from error

    @staticmethod
    def _found(place: str) -> ArmKind:
        module, _, member = place.rpartition(".")
        kind = getattr(import_module(module), member)
        if not isinstance(kind, ArmKind):
            raise TypeError("it is no ArmKind")
        return kind
