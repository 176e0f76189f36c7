"""Order: what somebody wants delivered; read from CSV or drawn from a seeded generator."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from fleet.errors import FleetError
from maps.site import Site

COLUMNS = ("id", "release_s", "pick", "drop", "mass_kg", "size_m")
MIN_EDGE_M, MAX_EDGE_M = 0.04, 0.10
MIN_MASS_KG, MAX_MASS_KG = 0.05, 2.0


class OrdersError(FleetError):
    """An orders file is malformed; names file and line."""


@dataclass(frozen=True, kw_only=True)
class Order:
    """One parcel to be taken from a pick station to a drop station."""

    name: str
    release_s: float
    """Time from which the order is known [s]."""
    pick: str
    drop: str
    mass_kg: float
    size_m: tuple[float, float, float]
    """Edges of the box [m]."""


def generate_orders(site: Site, n_orders: int, n_cars: int, rng: np.random.Generator) -> tuple[Order, ...]:
    """Draw orders: the first wave at time zero, then Poisson arrivals that keep the fleet busy.

    Args:
        site: Gives the station names.
        n_orders: Number of orders.
        n_cars: Fleet size; the mean time between arrivals is 20 s / n_cars after the first n_cars orders.
        rng: Source of randomness.

    Returns:
        Orders, ascending in release time.
    """
    picks = [s.name for s in site.stations if s.kind == "pick"]
    drops = [s.name for s in site.stations if s.kind == "drop"]
    release_s = 0.0
    orders = []
    for k in range(n_orders):
        if k >= n_cars:
            release_s += float(rng.exponential(20.0 / n_cars))
        edges = rng.uniform(0.05, 0.08, 3)
        orders.append(
            Order(
                name=f"order_{k + 1}",
                release_s=round(release_s, 3),
                pick=picks[int(rng.integers(len(picks)))],
                drop=drops[int(rng.integers(len(drops)))],
                mass_kg=round(float(rng.uniform(0.1, 0.5)), 3),
                size_m=(round(float(edges[0]), 4), round(float(edges[1]), 4), round(float(edges[2]), 4)),
            )
        )
    return tuple(orders)


def read_orders(path: Path, site: Site) -> tuple[Order, ...]:
    """Read orders from a CSV file with the header ``id,release_s,pick,drop,mass_kg,size_m``.

    `size_m` is one edge of a cube (``0.06``) or three edges (``0.06x0.05x0.08``).

    Args:
        path: The file.
        site: Gives the valid station names.

    Returns:
        Orders, ascending in release time (equal times keep the file's order).

    Raises:
        OrdersError: The file cannot be read, or a line is malformed; names the line and the valid values.
    """
    try:
        text = path.read_text(encoding="utf-8-sig")
    except OSError as error:
        raise OrdersError(f"orders file {path}: cannot be read ({error.strerror}); valid: a CSV file") from error
    except UnicodeDecodeError as error:
        raise OrdersError(f"orders file {path}: is not text in UTF-8 ({error.reason}); valid: a CSV file") from error
    reader = csv.reader(io.StringIO(text, newline=""))
    try:
        lines = [(reader.line_num, [field.strip() for field in row]) for row in reader]
    except csv.Error as error:
        raise OrdersError(f"orders file {path}, line {reader.line_num}: not CSV ({error})") from error
    rows = iter([(line, row) for line, row in lines if any(row)])
    header = next(rows, None)
    if header is None or tuple(header[1]) != COLUMNS:
        found = ",".join(header[1]) if header else "an empty file"
        raise OrdersError(f"orders file {path}, line 1: header is {found!r}; valid: {','.join(COLUMNS)}")
    orders: dict[str, Order] = {}
    for line, row in rows:
        where = f"orders file {path}, line {line}"
        if len(row) != len(COLUMNS):
            raise OrdersError(f"{where}: {len(row)} fields; valid: {len(COLUMNS)} ({','.join(COLUMNS)})")
        order = _parse_row(row, site, where)
        if order.name in orders:
            raise OrdersError(f"{where}: id {order.name!r} stands twice; valid: each id once")
        orders[order.name] = order
    if not orders:
        raise OrdersError(f"orders file {path}: no orders; valid: at least one line below the header")
    return tuple(sorted(orders.values(), key=lambda order: order.release_s))


def _parse_row(row: Sequence[str], site: Site, where: str) -> Order:
    name, release, pick, drop, mass, size = row
    if not name:
        raise OrdersError(f"{where}: id is empty; valid: any text")
    picks = [s.name for s in site.stations if s.kind == "pick"]
    drops = [s.name for s in site.stations if s.kind == "drop"]
    if pick not in picks:
        raise OrdersError(f"{where}: pick is {pick!r}; valid: {', '.join(picks)}")
    if drop not in drops:
        raise OrdersError(f"{where}: drop is {drop!r}; valid: {', '.join(drops)}")
    edges = [_number(part, "size_m", where, MIN_EDGE_M, MAX_EDGE_M) for part in size.lower().split("x")]
    if len(edges) == 1:
        edges *= 3
    if len(edges) != 3:
        raise OrdersError(f"{where}: size_m is {size!r}; valid: one edge (0.06) or three (0.06x0.05x0.08)")
    return Order(
        name=name,
        release_s=_number(release, "release_s", where, 0.0, 1e6),
        pick=pick,
        drop=drop,
        mass_kg=_number(mass, "mass_kg", where, MIN_MASS_KG, MAX_MASS_KG),
        size_m=(edges[0], edges[1], edges[2]),
    )


def _number(text: str, what: str, where: str, low: float, high: float) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not low <= value <= high:
        raise OrdersError(f"{where}: {what} is {text!r}; valid: a number from {low:g} to {high:g}")
    return value
