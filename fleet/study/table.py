"""Table: the rows of a study, and the CSV file that grows with every run."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Iterable
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, get_type_hints

from fleet.study.design import StudyError, Variant
from fleet.whole_file import write_whole

CSV_FILE = "study.csv"


@dataclass(frozen=True, kw_only=True)
class Row:
    """What one run achieved."""

    allocator: str
    robots: int
    seed: int
    released: int
    """Orders whose release time came within the run."""
    done: int
    failed: int
    throughput_per_h: float
    task_time_s: float | None
    """From release to delivery or the end of a visit, mean of the tasks done [s]."""
    task_time_p95_s: float | None
    tardiness_s: float | None
    """Time past the due date, mean over tasks with one: 0 if done by then, up to the end of the run if it is still
    open there [s]."""
    on_time_share: float | None
    """Done by their due date, of the tasks whose due date came within the run."""
    driving_loaded: float
    """This and the following nine: share of the cars' time, as the time accounts have it."""
    driving_empty: float
    traffic: float
    queue: float
    served: float
    charging: float
    fault: float
    idle: float
    visiting: float
    plan_late: float
    stations: str
    """Share of the time each station's arm was busy, and of that in which cars waited meanwhile, as
    ``pick_1=0.52/0.31 drop_1=0.44/0.05``."""
    bound_cars_per_h: float | None
    """Deliveries an hour at most by the cars; this and the following three as `fleet.insight.bounds` has them, None if
    nothing was delivered."""
    bound_arms_per_h: float | None
    bound_lanes_per_h: float | None
    bound_orders_per_h: float | None
    """By the orders that came; None if all were there from the start."""
    stalled: bool
    """Nothing went on any more before the time was up."""
    state_hash: str

    @property
    def variant(self) -> Variant:
        """The run it is of."""
        return Variant(self.seed, self.robots, self.allocator)

    @property
    def step_per_h(self) -> float:
        """What one delivery more or less makes of the throughput; 0 where nothing was delivered."""
        return self.throughput_per_h / self.done if self.done else 0.0

    @property
    def bounds_per_h(self) -> dict[str, float]:
        """The bounds that are known, by what binds."""
        bounds = {
            "cars": self.bound_cars_per_h,
            "arms": self.bound_arms_per_h,
            "lanes": self.bound_lanes_per_h,
            "orders": self.bound_orders_per_h,
        }
        return {name: per_h for name, per_h in bounds.items() if per_h is not None}

    @property
    def station_shares(self) -> dict[str, tuple[float, float]]:
        """`stations` as numbers: busy, contended."""
        parts = [part.partition("=") for part in self.stations.split()]
        return {name: (float(shares.split("/")[0]), float(shares.split("/")[1])) for name, _, shares in parts}


COLUMNS = tuple(field.name for field in fields(Row))


class TableFile:
    """The CSV file of a study, written line by line.

    Args:
        path: The file.
        rows: Rows it begins with; what was there is replaced.
    """

    def __init__(self, path: Path, rows: Iterable[Row]) -> None:
        self._path = path
        self.rows = list(rows)
        self._write()

    def add(self, row: Row) -> None:
        """Append a row, on disk at once."""
        self.rows.append(row)
        with self._path.open("a", newline="", encoding="utf-8") as file:
            csv.writer(file).writerow(_fields(row))

    def finish(self) -> None:
        """Put the rows into the order of their variants, whatever order the runs ended in."""
        self.rows.sort(key=lambda row: (row.allocator, row.robots, row.seed))
        self._write()

    def _write(self) -> None:
        text = io.StringIO(newline="")
        table = csv.writer(text)
        table.writerow(COLUMNS)
        table.writerows(_fields(row) for row in self.rows)
        write_whole(self._path, text.getvalue())


def read_rows(path: Path) -> list[Row]:
    """Read a study's CSV file; a last line that was cut off by a crash is left out.

    Raises:
        StudyError: The file is not one of a study; names the line.
    """
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise StudyError(f"study file {path}: cannot be read ({error}); valid: the CSV file of a study") from error
    whole = text[: text.rfind("\n") + 1]
    lines = list(csv.reader(whole.splitlines()))
    if not lines or tuple(lines[0]) != COLUMNS:
        raise StudyError(f"study file {path}, line 1: is not the header of a study; valid: {','.join(COLUMNS)}")
    rows = {}
    for number, line in enumerate(lines[1:], start=2):
        where = f"study file {path}, line {number}"
        row = _row(line, where)
        if row.variant in rows:
            raise StudyError(f"{where}: is the run of another line again; valid: each run once")
        rows[row.variant] = row
    return list(rows.values())


def _fields(row: Row) -> list[str]:
    return ["" if value is None else str(value) for value in vars(row).values()]


def _row(line: list[str], where: str) -> Row:
    if len(line) != len(COLUMNS):
        raise StudyError(f"{where}: {len(line)} fields; valid: {len(COLUMNS)}")
    values: dict[str, Any] = {}
    for (name, kind), text in zip(_TYPES.items(), line, strict=True):
        try:
            values[name] = _value(kind, text)
        except ValueError:
            raise StudyError(f"{where}: {name} is {text!r}; valid: {_VALID.get(kind, _MAYBE)}") from None
    return Row(**values)


def _value(kind: Any, text: str) -> Any:
    if kind is bool:
        if text not in ("True", "False"):
            raise ValueError(text)
        return text == "True"
    if kind in (int, str):
        return kind(text)
    if kind is float:
        return _finite(text)
    return _finite(text) if text else None


def _finite(text: str) -> float:
    number = float(text)
    if not math.isfinite(number):
        raise ValueError(text)
    return number


_VALID = {int: "an integer", float: "a finite number", bool: "True or False"}
_MAYBE = "a finite number, or nothing"
_TYPES = {name: get_type_hints(Row)[name] for name in COLUMNS}
