"""Codec: a message in the words of 3.0.0 becomes one of a dialect, and back.

What a dialect says that 3.0.0 has no word for is kept as it is.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

from fleet.vda5050.dialects import DIALECTS, Dialect
from fleet.vda5050.faults import ForeignMessageError, MessageError
from maps.reading.shown import shown

Body = dict[str, Any]
_DEEPEST = "some hundred levels"
_OPAQUE = "actionParameters"
"""What is inside belongs to the actions, whatever it is called."""
MOST_BYTES = 1 << 20
"""Longest message that is read [bytes]."""


class Codec:
    """Reads and writes the messages of one dialect.

    Args:
        dialect: The dialect.
    """

    def __init__(self, dialect: Dialect) -> None:
        self.dialect = dialect
        self._to_wire = dialect.fields
        self._from_wire = {
            topic: {wire: own for own, wire in names.items()} | dict(dialect.also_read.get(topic, {}))
            for topic, names in dialect.fields.items()
        }
        self._values_to_wire = _joined(dialect.values, dialect.nearest)
        self._values_from_wire = {
            name: {wire: own for own, wire in values.items()} for name, values in dialect.values.items()
        }

    def encode(self, topic: str, body: Body) -> Body:
        """A message of 3.0.0 as the dialect has it; the header is left as it is."""
        dialect = self.dialect
        dropped = dialect.unknown.get(topic, frozenset())
        if topic == "state" and not dialect.instant_states:
            body = {**body, "actionStates": body["actionStates"] + body["instantActionStates"]}
            del body["instantActionStates"]
        if topic == "order" and dialect.edge_ends:
            body = {**body, "edges": _with_ends(body["edges"], body["nodes"])}
        names = self._to_wire.get(topic, {})
        made: Body = self._written(body, names, dropped)
        return made

    def decode(self, topic: str, payload: bytes) -> Body:
        """A message of the dialect in the words of 3.0.0.

        Raises:
            MessageError: It is no JSON object, or has no header.
            ForeignMessageError: It is of another version.
        """
        body = _parsed(topic, payload)
        version = body.get("version")
        if not isinstance(version, str):
            raise MessageError(f"{topic}: version is {shown(version)}; valid: a text, {self.dialect.version!r}")
        if not self.dialect.speaks(version):
            raise ForeignMessageError(f"{topic}: version is {shown(version)}; valid: {self.dialect.version!r}")
        try:
            made: Body = self._read(body, self._from_wire.get(topic, {}))
        except RecursionError as error:
            raise MessageError(f"{topic}: the message is nested too deeply; valid: {_DEEPEST}") from error
        if topic == "state" and not self.dialect.instant_states:
            made.setdefault("instantActionStates", [])
        return made

    def _written(self, value: Any, names: Mapping[str, str], dropped: frozenset[str]) -> Any:
        if isinstance(value, list):
            return [self._written(one, names, dropped) for one in value]
        if not isinstance(value, Mapping):
            return value
        made: Body = {}
        for key, inner in value.items():
            if key in dropped:
                continue
            if key == _OPAQUE:
                made[names.get(key, key)] = inner
            elif key == "allowedDeviationXY" and not self.dialect.ellipses and isinstance(inner, Mapping):
                made[names.get(key, key)] = min(inner["a"], inner["b"])
            elif key == "errorType":
                made[key] = self.dialect.errors.get(inner, inner)
            else:
                said = _renamed(inner, self._values_to_wire.get(key, {}))
                made[names.get(key, key)] = self._written(said, names, dropped)
        return made

    def _read(self, value: Any, names: Mapping[str, str]) -> Any:
        if isinstance(value, list):
            return [self._read(one, names) for one in value]
        if not isinstance(value, Mapping):
            return value
        made: Body = {}
        for wire, inner in value.items():
            key = names.get(wire, wire)
            if inner is None:
                continue  # some write optional fields as null
            if key == _OPAQUE:
                made[key] = inner
            elif key == "allowedDeviationXY" and not self.dialect.ellipses and _is_number(inner):
                made[key] = {"a": inner, "b": inner, "theta": 0.0}
            elif key in ("startNodeId", "endNodeId") and self.dialect.edge_ends:
                continue  # the order of nodes and edges says the same
            else:
                made[key] = self._read(_renamed(inner, self._values_from_wire.get(key, {})), names)
        return made


def dialect_named(name: str) -> Dialect:
    """The dialect of a name.

    Raises:
        MessageError: There is none.
    """
    if name not in DIALECTS:
        raise MessageError(f"dialect is {name!r}; valid: {', '.join(DIALECTS)}")
    return DIALECTS[name]


def _parsed(topic: str, payload: bytes) -> Body:
    if len(payload) > MOST_BYTES:
        raise MessageError(f"{topic}: the message has {len(payload)} bytes; valid: at most {MOST_BYTES}")
    try:
        body = json.loads(payload)
    except (ValueError, RecursionError) as error:
        raise MessageError(f"{topic}: the message is no JSON ({error}); valid: a JSON object") from error
    if not isinstance(body, dict):
        raise MessageError(f"{topic}: the message is of type {type(body).__name__}; valid: a JSON object")
    return body


def _with_ends(edges: list[Body], nodes: list[Body]) -> list[Body]:
    """Edges with the nodes at their ends."""
    named = {node["sequenceId"]: node["nodeId"] for node in nodes}
    return [
        {**edge, "startNodeId": named[edge["sequenceId"] - 1], "endNodeId": named[edge["sequenceId"] + 1]}
        for edge in edges
    ]


def _renamed(value: Any, values: Mapping[str, str]) -> Any:
    """A value, or a list of them, as it is called on the other side."""
    if isinstance(value, str):
        return values.get(value, value)
    if values and isinstance(value, list):
        return [values.get(one, one) if isinstance(one, str) else one for one in value]
    return value


def _joined(*tables: Mapping[str, Mapping[str, str]]) -> dict[str, dict[str, str]]:
    made: dict[str, dict[str, str]] = {}
    for table in tables:
        for name, values in table.items():
            made.setdefault(name, {}).update(values)
    return made


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)
