"""Table: named columns of one length, for people who want to work on with the figures of a run."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from fleet.insight.time_table import data_frame
from fleet.whole_file import write_whole

Column = npt.NDArray[Any]


@dataclass(frozen=True, kw_only=True, eq=False)
class Table:
    """Columns of one length."""

    name: str
    """One word; the CSV file is called so."""
    columns: Mapping[str, Column]
    """By name, each shape (n,); a number that is not known is nan, a word that is not known is empty."""

    def __len__(self) -> int:
        return len(next(iter(self.columns.values()), ()))

    def __getitem__(self, name: str) -> Column:
        return self.columns[name]

    def rows(self) -> Iterator[dict[str, Any]]:
        """Row by row, as plain values."""
        for values in zip(*(column.tolist() for column in self.columns.values()), strict=True):
            yield dict(zip(self.columns, values, strict=True))

    def _repr_html_(self) -> str:
        """What a notebook shows."""
        head = "".join(f"<th>{escape(name)}</th>" for name in self.columns)
        body = "".join(
            "<tr>" + "".join(f"<td>{escape(_said(value))}</td>" for value in row.values()) + "</tr>"
            for row in self.rows()
        )
        return f"<table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>"

    def write_csv(self, directory: Path) -> Path:
        """Write `<name>.csv` into a directory; unknown numbers are left empty. Returns its path."""
        path = directory / f"{self.name}.csv"
        text = io.StringIO(newline="")
        writer = csv.writer(text)
        writer.writerow(self.columns)
        for row in self.rows():
            writer.writerow("" if value != value else value for value in row.values())  # noqa: PLR0124 - nan
        write_whole(path, text.getvalue())
        return path

    def frame(self) -> Any:
        """The same as a pandas data frame.

        Raises:
            NoPandas: pandas is not installed.
        """
        return data_frame({name: column.tolist() for name, column in self.columns.items()})


def _said(value: Any) -> str:
    """A value for people; empty if it is not known."""
    if isinstance(value, float):
        return "" if math.isnan(value) else f"{value:.4g}" if abs(value) < 1000.0 else f"{value:.0f}"
    return str(value)


def table(name: str, heads: Sequence[str], rows: Sequence[Sequence[Any]]) -> Table:
    """A table of its rows; None becomes nan."""
    columns: dict[str, Column] = {}
    for k, head in enumerate(heads):
        values = [row[k] for row in rows]
        words = any(isinstance(value, str) for value in values)
        columns[head] = np.array([("" if words else np.nan) if value is None else value for value in values])
    return Table(name=name, columns=columns)
