"""Order files: CSV or JSON; what is wrong with one order refuses that order and its followers, the rest goes on."""

from __future__ import annotations

import csv
import io
import json
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from fleet.errors import FleetError
from fleet.tasks.order import (
    MAX_EDGE_M,
    MAX_MASS_KG,
    MIN_EDGE_M,
    MIN_MASS_KG,
    Ability,
    Order,
    Priority,
    misfit,
)
from fleet.tasks.precedence import broken
from maps.site import Site

REQUIRED = ("id", "release_s", "pick", "drop", "mass_kg", "size_m")
OPTIONAL = ("due_s", "priority", "after", "picks", "needs")
LATEST_S = 1e6


class OrdersError(FleetError):
    """An orders file, or one order in it, is malformed; names file, line, field, value and valid values."""


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


def read_orders(path: Path, site: Site, abilities: Sequence[Ability]) -> OrderBook:
    """Read orders from a CSV file, or from a JSON file if its name ends in ``.json``.

    A CSV file has the columns ``id,release_s,pick,drop,mass_kg,size_m`` and may have
    ``due_s,priority,after,picks,needs``, in any order. `size_m` is one edge of a cube (``0.06``) or three edges
    (``0.06x0.05x0.08``); lists are separated by semicolons. A JSON file is a list of objects with the same entries,
    where numbers and lists may be written as such.

    Args:
        path: The file.
        site: Gives the valid station names.
        abilities: What each car can carry.

    Returns:
        The orders, and those that were refused in the order of the file.

    Raises:
        OrdersError: The file cannot be read as a whole, or no order is left.
    """
    try:
        text = path.read_text(encoding="utf-8-sig")
    except OSError as error:
        raise OrdersError(
            f"orders file {path}: cannot be read ({error.strerror}); valid: a CSV or JSON file"
        ) from error
    except UnicodeDecodeError as error:
        raise OrdersError(
            f"orders file {path}: is not text in UTF-8 ({error.reason}); valid: a CSV or JSON file"
        ) from error
    rows = _json_rows(path, text) if path.suffix.lower() == ".json" else _csv_rows(path, text)
    orders: dict[str, tuple[str, Order]] = {}
    refusals: dict[str, Refusal] = {}
    for row in rows:
        name = row.fields.get("id", "")
        try:
            if name in orders:
                raise OrdersError(f"id {name!r} stands twice; valid: each id once")
            orders[name] = (row.where, _order(row, site, abilities))
        except OrdersError as error:
            refusals[row.where] = Refusal(where=row.where, name=name, cause=str(error))
    lost = [refusal.name for refusal in refusals.values() if refusal.name]
    for name, cause in broken({name: order.after for name, (_, order) in orders.items()}, lost).items():
        where, _ = orders.pop(name)
        refusals[where] = Refusal(where=where, name=name, cause=cause)
    refused = tuple(refusals[row.where] for row in rows if row.where in refusals)
    if not orders:
        if not refused:
            raise OrdersError(f"orders file {path}: no orders; valid: at least one line below the header")
        more = f" (and {len(refused) - 1} more refused)" if len(refused) > 1 else ""
        raise OrdersError(f"{refused[0]}{more}; no order is left")
    kept = sorted((order for _, order in orders.values()), key=lambda order: order.release_s)
    return OrderBook(orders=tuple(kept), refused=refused)


def write_orders(path: Path, orders: Iterable[Order]) -> None:
    """Write orders as a CSV file that `read_orders` reads."""
    with path.open("w", newline="", encoding="utf-8") as file:
        table = csv.writer(file)
        table.writerow((*REQUIRED, *OPTIONAL))
        for order in orders:
            size = "x".join(str(edge) for edge in order.size_m)
            due = "" if math.isinf(order.due_s) else order.due_s
            lists = [";".join(words) for words in (order.after, order.picks[1:], order.needs)]
            required = (order.name, order.release_s, order.pick, order.drop, order.mass_kg, size)
            table.writerow([*required, due, order.priority, *lists])


def _csv_rows(path: Path, text: str) -> list[_Row]:
    reader = csv.reader(io.StringIO(text, newline=""))
    try:
        lines = [(reader.line_num, [field.strip() for field in row]) for row in reader]
    except csv.Error as error:
        raise OrdersError(f"orders file {path}, line {reader.line_num}: not CSV ({error})") from error
    lines = [(line, row) for line, row in lines if any(row)]
    line, header = lines[0] if lines else (1, [])
    if len(set(header)) != len(header) or not set(REQUIRED) <= set(header) <= {*REQUIRED, *OPTIONAL}:
        found = ",".join(header) if header else "an empty file"
        valid = f"{','.join(REQUIRED)} and any of {','.join(OPTIONAL)}, each once"
        raise OrdersError(f"orders file {path}, line {line}: header is {found!r}; valid: {valid}")
    rows = []
    for line, row in lines[1:]:
        where = f"orders file {path}, line {line}"
        if len(row) == len(header):
            rows.append(_Row(where=where, fields=dict(zip(header, row, strict=True))))
        else:
            fault = f"{len(row)} fields; valid: {len(header)} ({','.join(header)})"
            # Whoever waits for this order can be told that it was refused.
            name = row[header.index("id")] if len(row) > header.index("id") else ""
            rows.append(_Row(where=where, fields={"id": name}, fault=fault))
    return rows


def _json_rows(path: Path, text: str) -> list[_Row]:
    valid = "a list of objects"
    try:
        items = json.loads(text)
    except (json.JSONDecodeError, RecursionError) as error:
        raise OrdersError(f"orders file {path}: not JSON ({error}); valid: {valid}") from error
    if not isinstance(items, list):
        raise OrdersError(f"orders file {path}: holds {type(items).__name__}; valid: {valid}")
    return [_json_row(item, f"orders file {path}, order {k}") for k, item in enumerate(items, start=1)]


def _json_row(item: object, where: str) -> _Row:
    """The fields as text, as a CSV file would have them."""
    known = f"{', '.join(REQUIRED)} and any of {', '.join(OPTIONAL)}"
    if not isinstance(item, dict):
        return _Row(where=where, fields={}, fault=f"is {item!r}; valid: an object with {known}")
    fields: dict[str, str] = {}
    fault = ""
    for name, value in item.items():
        parts = value if isinstance(value, list) else [value]
        if name not in (*REQUIRED, *OPTIONAL):
            fault = fault or f"{name} is not a known entry; valid: {known}"
        elif not all(isinstance(part, str | int | float) and not isinstance(part, bool) for part in parts):
            fault = fault or f"{name} is {value!r}; valid: text, a number, or a list of these"
        else:
            fields[name] = ("x" if name == "size_m" else ";").join(str(part).strip() for part in parts)
    missing = [name for name in REQUIRED if name not in fields]
    if missing:
        fault = fault or f"{missing[0]} is missing; valid: {known}"
    return _Row(where=where, fields=fields, fault=fault)


def _order(line: _Row, site: Site, abilities: Sequence[Ability]) -> Order:
    """Build an order from text.

    Raises:
        OrdersError: Names field, value and valid values.
    """
    if line.fault:
        raise OrdersError(line.fault)
    row = line.fields
    if not row["id"]:
        raise OrdersError("id is empty; valid: any text")
    picks = site.station_names("pick")
    drops = site.station_names("drop")
    sources = tuple(dict.fromkeys((row["pick"], *_words(row, "picks"))))
    for name, value, valid in [("pick", row["pick"], picks), *(("picks", source, picks) for source in sources)]:
        if value not in valid:
            raise OrdersError(f"{name} is {value!r}; valid: {', '.join(valid)}")
    if row["drop"] not in drops:
        raise OrdersError(f"drop is {row['drop']!r}; valid: {', '.join(drops)}")
    priority = row.get("priority") or Priority.NORMAL
    if priority not in list(Priority):
        raise OrdersError(f"priority is {priority!r}; valid: {', '.join(Priority)}")
    edges = [_number(part, "size_m", MIN_EDGE_M, MAX_EDGE_M) for part in row["size_m"].lower().split("x")]
    if len(edges) == 1:
        edges *= 3
    if len(edges) != 3:
        raise OrdersError(f"size_m is {row['size_m']!r}; valid: one edge (0.06) or three (0.06x0.05x0.08)")
    release_s = _number(row["release_s"], "release_s", 0.0, LATEST_S)
    due_s = _number(row["due_s"], "due_s", 0.0, LATEST_S) if row.get("due_s") else math.inf
    if due_s < release_s:
        raise OrdersError(f"due_s is {row['due_s']!r}; valid: a number from {release_s:g} (release_s)")
    order = Order(
        name=row["id"],
        release_s=release_s,
        pick=row["pick"],
        drop=row["drop"],
        mass_kg=_number(row["mass_kg"], "mass_kg", MIN_MASS_KG, MAX_MASS_KG),
        size_m=(edges[0], edges[1], edges[2]),
        due_s=due_s,
        priority=Priority(priority),
        after=_words(row, "after"),
        picks=sources,
        needs=_words(row, "needs"),
    )
    cause = misfit(order, abilities)
    if cause is not None:
        raise OrdersError(cause)
    return order


def _words(row: Mapping[str, str], name: str) -> tuple[str, ...]:
    """The different words of a list."""
    words = (word.strip() for word in row.get(name, "").split(";"))
    return tuple(dict.fromkeys(word for word in words if word))


def _number(text: str, what: str, low: float, high: float) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not low <= value <= high:
        raise OrdersError(f"{what} is {text!r}; valid: a number from {low:g} to {high:g}")
    return value
