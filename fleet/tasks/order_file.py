"""Order files: CSV or JSON; what is wrong with one order refuses that order and its followers, the rest goes on."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from fleet.tasks import TASK_TYPES
from fleet.tasks.fields import Fields, OrdersError
from fleet.tasks.order import Ability, Order, Priority, misfit
from fleet.tasks.place_names import PlaceNames
from fleet.tasks.precedence import broken
from fleet.tasks.types.task_type import Setting
from maps.reading.shown import named, shown
from maps.reading.text_file import FileError, parse_json, read_text
from maps.site import Site

REQUIRED = ("id", "release_s")
OPTIONAL = ("type", "due_s", "priority", "after", "needs", "batch", "every_s", "times")
"""Fields of orders of all types."""
DEFAULT_TYPE = "delivery"
LATEST_S = 1e6
MAX_TIMES = 1000
_OWN = tuple(dict.fromkeys(name for kind in TASK_TYPES.values() for name in (*kind.required, *kind.optional)))
"""Fields that only some types have."""
_KNOWN = (*REQUIRED, *OPTIONAL, *_OWN)


@dataclass(frozen=True, kw_only=True)
class Refusal:
    """An order that cannot be accepted."""

    where: str
    """File, and line or number in it."""
    name: str
    """Its id; empty if it has none."""
    cause: str
    """Field, value and valid values."""

    def __str__(self) -> str:
        return f"{self.where}: {self.cause}"


@dataclass(frozen=True, kw_only=True)
class _Row:
    """One order as the file has it."""

    where: str
    fields: dict[str, str]
    fault: str = ""
    """Why the fields cannot be told; empty if they can."""


@dataclass(frozen=True, kw_only=True)
class OrderBook:
    """The orders of a run."""

    orders: tuple[Order, ...]
    """Ascending in release time; equal times keep the file's order."""
    refused: tuple[Refusal, ...] = ()


def read_orders(
    path: Path, site: Site, abilities: Sequence[Ability], *, n_chargers: int = 0, grip_kg: float = math.inf
) -> OrderBook:
    """Read orders from a CSV file, or from a JSON file if its name ends in ``.json``.

    Every order has the fields ``id,release_s`` and those that its ``type`` asks for (see `TASK_TYPES`; without one it
    is a delivery), and may have ``due_s,priority,after,needs,batch,every_s,times`` and what else its type knows. In a
    CSV file they are columns in any order; lists are separated by semicolons, and ``size_m`` is one edge of a cube
    (``0.06``) or three edges (``0.06x0.05x0.08``). A JSON file is a list of objects with the same entries, where
    numbers and lists may be written as such.

    An order with ``every_s`` and ``times`` becomes as many orders, ``id_1``, ``id_2``, ..., released one after the
    other. What waits for it, by its id in ``after``, waits for all of them.

    Args:
        path: The file.
        site: Gives the valid names of stations and places.
        abilities: What each car can carry.
        n_chargers: Chargers in use; 0 = cars have no batteries.
        grip_kg: Heaviest parcel that the arms' tools hold [kg].

    Returns:
        The orders, and those that were refused in the order of the file.

    Raises:
        OrdersError: The file cannot be read as a whole, or no order is left.
    """
    try:
        text = read_text(path, f"orders file {path}", valid="a CSV or JSON file")
    except FileError as error:
        raise OrdersError(str(error)) from error
    rows = _json_rows(path, text) if path.suffix.lower() == ".json" else _csv_rows(path, text)
    setting = Setting(site=site, places=PlaceNames(site), n_chargers=n_chargers)
    accepted: dict[str, tuple[str, tuple[Order, ...]]] = {}
    refusals: dict[str, Refusal] = {}
    taken: dict[str, str] = {}
    released_s: dict[str, float] = {}
    for row in rows:
        name = row.fields.get("id", "")
        try:
            orders = _unfold(row, setting, abilities, grip_kg)
            twice = next((word for word in (name, *(order.name for order in orders)) if word in taken), None)
            if twice is not None:
                of = f", and that of {taken[twice]!r} has this number" if twice != taken[twice] else ""
                raise OrdersError(f"id {shown(twice)} stands twice{of}; valid: each id once")
            _check_batch(orders[0], released_s)
        except OrdersError as error:
            refusals[row.where] = Refusal(where=row.where, name=name, cause=str(error))
            continue
        taken |= dict.fromkeys((name, *(order.name for order in orders)), name)
        accepted[name] = (row.where, orders)
    parts = _number_predecessors({name: orders for name, (_, orders) in accepted.items()})
    lost = [refusal.name for refusal in refusals.values() if refusal.name]
    after = {order.name: order.after for orders in parts.values() for order in orders}
    for part, cause in broken(after, lost).items():
        where, _ = accepted[taken[part]]
        parts.pop(taken[part], None)
        refusals.setdefault(where, Refusal(where=where, name=taken[part], cause=cause))
    refused = tuple(refusals[row.where] for row in rows if row.where in refusals)
    if not parts:
        if not refused:
            raise OrdersError(f"orders file {path}: no orders; valid: at least one line below the header")
        more = f" (and {len(refused) - 1} more refused)" if len(refused) > 1 else ""
        raise OrdersError(f"{refused[0]}{more}; no order is left")
    kept = sorted((order for orders in parts.values() for order in orders), key=lambda order: order.release_s)
    return OrderBook(orders=tuple(kept), refused=refused)


@dataclass(frozen=True, kw_only=True)
class OrderTerms:
    """What an order has to fit."""

    site: Site
    abilities: Sequence[Ability]
    """What each car can carry."""
    n_chargers: int = 0
    """Chargers in use; 0 = cars have no batteries."""
    grip_kg: float = math.inf
    """Heaviest parcel that the arms' tools hold [kg]."""


def read_order(fields: object, terms: OrderTerms) -> Order:
    """Read one order that stands alone, as one of a JSON file.

    Args:
        fields: A dictionary with the entries of an order, see `read_orders`.
        terms: What it has to fit.

    Raises:
        OrdersError: It cannot be accepted, or is made of several; names field, value and valid values.
    """
    setting = Setting(site=terms.site, places=PlaceNames(terms.site), n_chargers=terms.n_chargers)
    orders = _unfold(_json_row(fields, "order"), setting, terms.abilities, terms.grip_kg)
    alone = len(orders) == 1 and not (orders[0].after or orders[0].batch)
    if not alone:
        raise OrdersError(f"order {shown(orders[0].name)} is one of several; valid: one that stands alone")
    return orders[0]


def _csv_rows(path: Path, text: str) -> list[_Row]:
    reader = csv.reader(io.StringIO(text, newline=""))
    try:
        lines = [(reader.line_num, [field.strip() for field in row]) for row in reader]
    except csv.Error as error:
        raise OrdersError(f"orders file {path}, line {reader.line_num}: not CSV ({error}); valid: CSV") from error
    lines = [(line, row) for line, row in lines if any(row)]
    line, header = lines[0] if lines else (1, [])
    required = REQUIRED if "type" in header else (*REQUIRED, *TASK_TYPES[DEFAULT_TYPE].required)
    if len(set(header)) != len(header) or not set(required) <= set(header) <= set(_KNOWN):
        found = ",".join(header) if header else "an empty file"
        valid = f"{','.join(required)} and any of {','.join(n for n in _KNOWN if n not in required)}, each once"
        raise OrdersError(f"orders file {path}, line {line}: header is {shown(found)}; valid: {valid}")
    rows = []
    for line, row in lines[1:]:
        where = f"orders file {path}, line {line}"
        if len(row) == len(header):
            rows.append(_Row(where=where, fields=dict(zip(header, row, strict=True))))
        else:
            fault = f"{len(row)} fields; valid: {len(header)} ({','.join(header)})"
            fault += ", and what holds a comma, such as a cell, in quotes" if len(row) > len(header) else ""
            # Whoever waits for this order can be told that it was refused.
            name = row[header.index("id")] if len(row) > header.index("id") else ""
            rows.append(_Row(where=where, fields={"id": name}, fault=fault))
    return rows


def _json_rows(path: Path, text: str) -> list[_Row]:
    valid = "a list of objects"
    try:
        items = parse_json(text, f"orders file {path}", valid=valid)
    except FileError as error:
        raise OrdersError(str(error)) from error
    if not isinstance(items, list):
        raise OrdersError(f"orders file {path}: holds {type(items).__name__}; valid: {valid}")
    return [_json_row(item, f"orders file {path}, order {k}") for k, item in enumerate(items, start=1)]


def _json_row(item: object, where: str) -> _Row:
    """The fields as text, as a CSV file would have them."""
    known = f"{', '.join(REQUIRED)} and any of {', '.join((*OPTIONAL, *_OWN))}"
    if not isinstance(item, dict):
        return _Row(where=where, fields={}, fault=f"is {shown(item)}; valid: an object with {known}")
    fields: dict[str, str] = {}
    fault = ""
    for name, value in item.items():
        if name not in _KNOWN:
            fault = fault or f"{named(name)} is not a known entry; valid: {known}"
            continue
        text = _edges_text(value) if name == "size_m" else _text(value, ";")
        if text is None:
            fault = fault or f"{name} is {shown(value)}; valid: text, a number, or a list of these"
        else:
            fields[name] = text
    missing = [name for name in REQUIRED if name not in fields]
    if missing:
        fault = fault or f"{missing[0]} is missing; valid: {known}"
    return _Row(where=where, fields=fields, fault=fault)


def _text(value: object, separator: str) -> str | None:
    """A JSON value as a CSV file would have it; None if it is neither text, nor a number, nor a list of these."""
    parts = value if isinstance(value, list) else [value]
    if not all(isinstance(part, str | int | float) and not isinstance(part, bool) for part in parts):
        return None
    return separator.join(str(part).strip() for part in parts)


def _edges_text(value: object) -> str | None:
    """One size, as a number or three, or a list of sizes."""
    if not isinstance(value, list) or not any(isinstance(part, str | list) for part in value):
        return _text(value, "x")
    sizes = [_text(part, "x") for part in value]
    return None if None in sizes else ";".join(size for size in sizes if size is not None)


def _unfold(row: _Row, setting: Setting, abilities: Sequence[Ability], grip_kg: float) -> tuple[Order, ...]:
    """The deliveries and visits of one order, one round after the other.

    Raises:
        OrdersError: Names field, value and valid values.
    """
    if row.fault:
        raise OrdersError(row.fault)
    fields = Fields(row.fields)
    shared = _shared(fields)
    word = fields.text("type") or DEFAULT_TYPE
    if word not in TASK_TYPES:
        raise OrdersError(f"type is {shown(word)}; valid: {', '.join(TASK_TYPES)}")
    kind = TASK_TYPES[word]
    for name in kind.required:
        if not fields.text(name):
            raise OrdersError(f"{name} is missing; valid: a {word} has {', '.join(kind.required)}")
    own = (*kind.required, *kind.optional)
    strange = next((name for name in fields.given if name in _OWN and name not in own), None)
    if strange is not None:
        raise OrdersError(f"{strange} is {shown(fields.text(strange))}; valid: nothing, a {word} has {', '.join(own)}")
    rounds = [kind.orders(one, fields, setting) for one in _rounds(shared, fields)]
    cause = misfit(rounds[0][0], abilities, grip_kg)
    if cause is not None:
        raise OrdersError(cause)
    return tuple(order for orders in rounds for order in orders)


def _shared(fields: Fields) -> Order:
    """What orders of all types have."""
    name = fields.text("id")
    if not name:
        raise OrdersError("id is empty; valid: any text")
    if ";" in name or not name.isprintable():
        raise OrdersError(f"id is {shown(name)}; valid: text in one line, without semicolons")
    release_s = fields.number("release_s", 0.0, LATEST_S)
    due_s = fields.number("due_s", 0.0, LATEST_S, math.inf)
    if due_s < release_s:
        raise OrdersError(f"due_s is {shown(fields.text('due_s'))}; valid: a number from {release_s:g} (release_s)")
    priority = Priority(fields.choice("priority", list(Priority))) if fields.text("priority") else Priority.NORMAL
    return Order(
        name=name,
        release_s=release_s,
        due_s=due_s,
        priority=priority,
        after=tuple(dict.fromkeys(fields.words("after"))),
        needs=tuple(dict.fromkeys(fields.words("needs"))),
        batch=fields.text("batch"),
    )


def _rounds(shared: Order, fields: Fields) -> list[Order]:
    """The order itself, or one for each time it recurs."""
    if not fields.text("every_s") and not fields.text("times"):
        return [shared]
    every_s = fields.number("every_s", 1.0, LATEST_S)
    times = fields.number("times", 2, MAX_TIMES)
    if not times.is_integer():
        raise OrdersError(f"times is {shown(fields.text('times'))}; valid: a whole number from 2 to {MAX_TIMES}")
    if shared.batch:
        raise OrdersError(f"batch is {shown(shared.batch)}; valid: none for an order that recurs")
    return [
        replace(
            shared,
            name=f"{shared.name}_{k + 1}",
            release_s=shared.release_s + k * every_s,
            due_s=shared.due_s + k * every_s,
        )
        for k in range(int(times))
    ]


def _check_batch(order: Order, released_s: dict[str, float]) -> None:
    """Refuse an order that is not released with the others of its batch."""
    if not order.batch:
        return
    first_s = released_s.setdefault(order.batch, order.release_s)
    if order.release_s != first_s:
        where = f"as the others of batch {shown(order.batch)}"
        raise OrdersError(f"release_s is '{order.release_s:g}'; valid: {first_s:g}, {where}")


def _number_predecessors(orders_of: dict[str, tuple[Order, ...]]) -> dict[str, list[Order]]:
    """Let those that wait for an order by its id wait for all that it has become."""
    names = {name: tuple(order.name for order in orders) for name, orders in orders_of.items()}
    return {
        name: [
            replace(order, after=tuple(part for first in order.after for part in names.get(first, (first,))))
            for order in orders
        ]
        for name, orders in orders_of.items()
    }
