"""Registry: members of a family by name, or by the dotted name of a class of one's own, each with its settings."""

from __future__ import annotations

import importlib
import inspect
import sys
import traceback
from collections.abc import Iterator, Mapping
from dataclasses import is_dataclass
from typing import Any, TypeVar, get_args, get_type_hints

from maps.reading.near import hint
from planners.errors import PlanningError
from planners.settings import field_names, misfits

T = TypeVar("T")

NO_SETTINGS: Mapping[str, object] = {}
"""All settings as they are by default."""


class MemberError(PlanningError):
    """A family has no member of that name, or it cannot be made."""


class SettingError(PlanningError):
    """A member of a family has no such setting, or the setting takes another kind of value."""


class Family(Mapping[str, type[T]]):
    """Classes that do the same work, by name; each is imported when it is first asked for.

    Args:
        role: What a member is, such as planner.
        method: How a member is called, such as `plan(instance) -> Plan`; a class of one's own has to have the method.
        members: `package.module.Class` of each member, by name.
    """

    def __init__(self, role: str, method: str, members: Mapping[str, str]) -> None:
        self.role = role
        self._method = method
        self._members = dict(members)

    def __getitem__(self, name: str) -> type[T]:
        member: type[T] = _found(self._members[name])
        return member

    def __contains__(self, name: object) -> bool:
        return name in self._members

    def __iter__(self) -> Iterator[str]:
        return iter(self._members)

    def __len__(self) -> int:
        return len(self._members)

    @property
    def valid(self) -> str:
        """All that can be named, for messages and help."""
        return f"{', '.join(self)} or package.module.Class"

    def make(self, name: str, settings: Mapping[str, object] = NO_SETTINGS, *, what: str = "", **others: Any) -> T:
        """Make a member.

        Args:
            name: A name of the family, or `package.module.Class`.
            settings: Fields of the dataclass that its class takes as `config`; the others keep their defaults.
            what: What chose the name, for messages; the role if not given.
            others: What else its class is called with.

        Raises:
            MemberError: There is no such class, or it cannot be made; says the valid choices.
            SettingError: It has no such setting, or the value is of another kind; says what is valid.
            PlanningError: A setting is out of its range.
        """
        wrong = f"{what or self.role} is {name!r}"
        if name in self:
            kind = self[name]
        elif isinstance(name, str) and all(name.rpartition(".")):
            kind = self._own(name, wrong)
        else:
            raise MemberError(f"{wrong}{hint(name, self)}; valid: {self.valid}")
        if settings:
            others["config"] = self._config(name, kind, settings)
        try:
            inspect.signature(kind).bind(**others)
        except (TypeError, ValueError) as error:
            arguments = ", ".join(f"{argument}=" for argument in others) or "no arguments"
            raise MemberError(f"{wrong}: {error}; valid: a class that is made with {arguments}") from error
        return kind(**others)

    def _own(self, name: str, wrong: str) -> type[T]:
        """A class of one's own; that its module cannot be imported is told in one line, too."""
        try:
            found = _found(name)
        except (ImportError, AttributeError, ValueError) as error:
            raise MemberError(f"{wrong}: {error}; valid: {self.valid}") from error
        except Exception as error:
            raise MemberError(f"{wrong}: {told(error)}; valid: a module that can be imported") from error
        if not (isinstance(found, type) and callable(getattr(found, self._method.partition("(")[0], None))):
            raise MemberError(f"{wrong}, which is no class with {self._method}; valid: {self.valid}")
        return found

    def _config(self, name: str, kind: type[T], settings: Mapping[str, object]) -> object:
        """The settings of a class, as the dataclass that it takes."""
        whose = f"of {self.role} {name!r}"
        try:
            config = config_type(kind)
        except Exception as error:  # annotations of somebody else are resolved: names may be missing
            raise MemberError(f"settings {whose}: {told(error)}; valid: annotations that can be read") from error
        known = () if config is None else field_names(config)
        unknown = next((setting for setting in settings if setting not in known), None)
        if config is None or unknown is not None:
            valid = ", ".join(known) or f"none, this {self.role} has no settings"
            raise SettingError(f"setting {unknown!r} {whose} is unknown{hint(unknown, known)}; valid: {valid}")
        for setting, value, valid in misfits(config, settings):
            raise SettingError(f"setting {setting!r} {whose} is {value!r}; valid: {valid}")
        return config(**settings)


def told(error: Exception, module: str = "") -> str:
    """One line of an error in somebody's module: its kind, its words, and the last place in that module on its way."""
    way = traceback.extract_tb(error.__traceback__)
    theirs = getattr(sys.modules.get(module), "__file__", None)
    at = next((frame for frame in reversed(way) if frame.filename == theirs), way[-1])
    return f"{type(error).__name__}: {error} ({at.filename}, line {at.lineno})"


def config_type(kind: type) -> type[Any] | None:
    """The dataclass of settings that a class takes as `config`, by its annotation; None if it has no settings."""
    declared = get_type_hints(kind.__init__).get("config")  # type: ignore[misc]  # of the class itself, not of a part
    either = (declared, *get_args(declared))
    return next((each for each in either if isinstance(each, type) and is_dataclass(each)), None)


def _found(place: str) -> Any:
    """What has a dotted name."""
    module, _, name = place.rpartition(".")
    return getattr(importlib.import_module(module), name)
