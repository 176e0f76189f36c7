"""Time table: the time accounts of a run as columns, for data frames and CSV files."""

from __future__ import annotations

import csv
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np

from fleet.errors import FleetError
from fleet.insight.codebook import Codebook
from fleet.insight.time_accounts import Account, Ticks, TimeAccounts
from fleet.whole_file import draft_of

Columns = dict[str, list[Any]]
"""A table by columns of equal length."""
NOBODY = "none"
"""What time is put down to that nobody caused."""


class NoPandas(FleetError):
    """Data frames need a package that is not installed."""


@dataclass(frozen=True, kw_only=True)
class Blame:
    """Ticks of all robots by account and what they are put down to (`TimeAccounts`); rows without a tick are left out.

    In each of the three tables all ticks of an account add up to what all robots have spent on it.
    """

    robots: Columns
    """Columns account, robot, ticks."""
    cells: Columns
    """Columns account, row, col, ticks; row and col are -1 for none."""
    places: Columns
    """Columns account, place, ticks."""


def blame_of(time_accounts: TimeAccounts, codebook: Codebook) -> Blame:
    """What the time of a run is put down to."""
    robots, cells, places = (
        _entries(time_accounts.by_robot),
        _entries(time_accounts.by_cell),
        _entries(time_accounts.by_place),
    )
    n_cells = time_accounts.by_cell.shape[1] - 1
    at = [(-1, -1) if cell == n_cells else divmod(cell, codebook.cols) for _, cell, _ in cells]
    return Blame(
        robots=_columns(("account", "robot", "ticks"), _named(robots, (*codebook.robots, NOBODY))),
        cells=_columns(
            ("account", "row", "col", "ticks"),
            [(account, row, col, ticks) for (account, _, ticks), (row, col) in zip(cells, at, strict=True)],
        ),
        places=_columns(("account", "place", "ticks"), _named(places, (*codebook.places, NOBODY))),
    )


def time_columns(result: Mapping[str, Any]) -> Columns:
    """Where the time of every robot went.

    Args:
        result: What `result.json` holds, or a `Summary` as a mapping.

    Returns:
        Columns robot, account, ticks, time_s, percent; robots in order, accounts without time included.

    Raises:
        KeyError: It is not the result of a run of this version.
    """
    spent = {**result["car_ticks"], **result["arm_ticks"]}
    rows = []
    for robot, accounts in spent.items():
        ticks = dict(accounts)
        total = sum(ticks.values())
        for account, n in ticks.items():
            share = n / total if total else 0.0
            rows.append((robot, account, n, round(share * result["sim_s"], 6), 100.0 * share))
    return _columns(("robot", "account", "ticks", "time_s", "percent"), rows)


def write_csv(path: Path, columns: Columns) -> None:
    """Write a table with a line of names first."""
    with draft_of(path) as draft, draft.open("w", newline="", encoding="utf-8") as file:
        lines = csv.writer(file)
        lines.writerow(columns)
        lines.writerows(zip(*columns.values(), strict=True))


def data_frame(columns: Columns) -> Any:
    """The table as a pandas data frame.

    Raises:
        NoPandas: pandas is not installed; the columns themselves need no package.
    """
    try:
        pandas = import_module("pandas")
    except ImportError as error:
        raise NoPandas("data frames: pandas is not installed; valid: pip install pandas, or the columns") from error
    return pandas.DataFrame(columns)


def _entries(table: Ticks) -> list[tuple[str, int, int]]:
    """Account, number and ticks where there are any."""
    accounts, numbers = np.nonzero(table)
    names = [Account(account).name.lower() for account in accounts.tolist()]
    return list(zip(names, numbers.tolist(), table[accounts, numbers].tolist(), strict=True))


def _named(entries: Iterable[tuple[str, int, int]], names: Sequence[str]) -> list[tuple[str, str, int]]:
    return [(account, names[number], ticks) for account, number, ticks in entries]


def _columns(names: Sequence[str], rows: Sequence[Sequence[Any]]) -> Columns:
    return {name: [row[k] for row in rows] for k, name in enumerate(names)}
