"""TraceFile: a digest of every tick of a run, and what its robots did and were told, written down on change.

Two runs can be compared with it to the tick without keeping the positions of everything at every tick: as long as two
runs are the same, so are their digests, which are made of all motion and of what has changed. A file is a line of JSON
and blocks of some ticks, each written out at once: all whole blocks of a killed run can be read.
"""

from __future__ import annotations

import json
import struct
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import IntEnum
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from numba import njit

from fleet.arrays import FloatArray, IntArray
from fleet.insight.causes import robot_names
from fleet.recording.errors import OutputError
from fleet.recording.output_file import OutputFile
from maps.grid import HEADING_NAMES
from maps.reading.shown import shown
from maps.reading.text_file import parse_json

TRACE = "run.trace"
VERSION = 2
UNKNOWN = np.iinfo(np.int32).min
"""What a quantity is before it is known."""

Ints = IntArray


class Quantity(IntEnum):
    """What is written down of each robot when it changes, in the order in which it is decided within a tick."""

    PHASE = 0
    """What a car is about: index into the phases of the header; of an arm, its state."""
    PLACE = 1
    """Station or other bookable place a car is bound for or at; -1 for none. Of an arm, the car it serves."""
    GOAL = 2
    """State a car is sent to, as 4 * cell + heading; -1 for none."""
    PLAN_END = 3
    """State in which its plan ends so far, in the same form."""
    GRANTED = 4
    """Moves a car was granted so far."""
    CELL = 5
    """Cell its rear axle is in; -1 off the floor."""


CHANGE = np.dtype([("tick", "<i4"), ("robot", "<u2"), ("quantity", "u1"), ("value", "<i4")])
"""One change; robots are the cars, then the arms."""
MOST_ROBOTS = 2**16
"""Whose changes can be told apart."""
_DIGEST, _MARK = np.dtype("<u8"), np.dtype("<u2")
_SIZES = struct.Struct("<II")
"""Begins a block: how many ticks it has, and how many changes."""


class TraceFile(OutputFile):
    """Writes the trace of a run; use as a context manager, or call `close`.

    Args:
        directory: As returned by `prepare_output`.
        n_cars: Number of cars.
        n_arms: Number of arms.
        about: What a reader needs to name things, see `Trace`.

    Raises:
        OutputError: The file cannot be opened.
    """

    def __init__(self, directory: Path, *, n_cars: int, n_arms: int, about: Mapping[str, object]) -> None:
        super().__init__(directory, TRACE)
        header = {"kind": "trace", "version": VERSION, "cars": n_cars, "arms": n_arms, **about}
        # A run that is killed in its first second has a trace without ticks.
        self._append(json.dumps(header, separators=(",", ":")).encode() + b"\n")
        n = n_cars + n_arms
        self._known = np.full((len(Quantity), n), UNKNOWN, dtype=np.int64)

    def write(self, tick: int, values: Ints, motion: FloatArray) -> None:
        """Write how some ticks ended; call it with the first tick after those of the last call.

        Args:
            tick: The first of them.
            values: `Quantity` of each robot at each tick; `UNKNOWN` where a robot has none, shape (n_ticks,
                n_quantities, n_robots).
            motion: Whatever decides how each robot goes on to move, shape (n_ticks, n_robots, k).
        """
        n_ticks, n_quantities, n_robots = values.shape
        digests = np.zeros(n_ticks, dtype=_DIGEST)
        marks = np.zeros((n_ticks, n_robots), dtype=_MARK)
        changes = np.zeros(n_ticks * n_quantities * n_robots, dtype=CHANGE)
        n_changes = _digest(tick, values, motion, self._known, digests, marks, changes)
        sizes = _SIZES.pack(n_ticks, n_changes)
        self._append(sizes + digests.tobytes() + marks.tobytes() + changes[:n_changes].tobytes())


@dataclass(frozen=True, kw_only=True, eq=False)
class Trace:
    """The trace of a run."""

    run: str
    """Name of the run, see `fleet.recording.run_file.RunRecord`."""
    tick_s: float
    """Length of a tick [s]."""
    n_cars: int
    n_arms: int
    plan: tuple[str, ...]
    """The drawing of the site, one character for each cell."""
    cell_m: float
    """Edge of a cell [m]."""
    stations: tuple[str, ...]
    """Their names, in the order of the arms."""
    places: tuple[str, ...]
    """Names of all bookable places, stations first."""
    place_cells: tuple[int, ...]
    """Cells of these places; empty in traces that do not tell."""
    phases: tuple[str, ...]
    """Phases of cars."""
    arm_states: tuple[str, ...]
    digests: npt.NDArray[np.uint64]
    """One for each tick from the first, shape (n_ticks,)."""
    marks: npt.NDArray[np.uint16]
    """A short digest of how each robot stands and moves, shape (n_ticks, n_robots)."""
    changes: npt.NDArray[Any]
    """Rows of type `CHANGE`, ascending in tick."""

    @property
    def robots(self) -> tuple[str, ...]:
        """Names of all robots."""
        return robot_names(self.n_cars, self.n_arms)

    @property
    def size_m(self) -> tuple[float, float]:
        """Extent of the floor along x and y [m]."""
        return len(self.plan[0]) * self.cell_m, len(self.plan) * self.cell_m

    @property
    def n_ticks(self) -> int:
        """Number of ticks."""
        return len(self.digests)

    def series(self, robot: int, quantity: Quantity) -> tuple[Ints, Ints]:
        """Ticks at which a quantity of a robot changed, and its values from then on, each shape (k,)."""
        rows = self.changes[(self.changes["robot"] == robot) & (self.changes["quantity"] == quantity)]
        return rows["tick"].astype(np.int64), rows["value"].astype(np.int64)

    def words(self, quantity: Quantity, robot: int, value: int) -> str:
        """A value as a person would say it."""
        if value == UNKNOWN:
            return "unknown"
        car = robot < self.n_cars
        columns = len(self.plan[0])
        if quantity is Quantity.PHASE:
            return _name(self.phases if car else self.arm_states, value)
        if quantity is Quantity.PLACE:
            return (_name(self.places, value) if car else f"car_{value}") if value >= 0 else "none"
        if quantity is Quantity.GRANTED:
            return f"{value} moves"
        if value < 0:
            return "none"
        if quantity is Quantity.CELL:
            return f"cell ({value // columns}, {value % columns})"
        cell, heading = divmod(value, 4)
        return f"cell ({cell // columns}, {cell % columns}) facing {HEADING_NAMES[heading]}"


def read_trace(directory: Path) -> Trace:
    """Read the trace of a run up to where it is whole.

    Args:
        directory: The run's output directory.

    Returns:
        The trace; without ticks if the run ended in its first second.

    Raises:
        OutputError: There is no trace, it is of another version, or it is something else.
    """
    path = directory / TRACE
    valid = f"valid: a run of this version of fleet, whose {TRACE} has version {VERSION}"
    try:
        file = path.open("rb")
    except OSError as error:
        raise OutputError(f"no trace in {directory}: {TRACE}: {error.strerror}; {valid}") from error
    with file:
        try:
            header = parse_json(file.readline(1 << 20).decode(), str(path), valid="one JSON object")
            kind, version = header["kind"], header["version"]
        except (ValueError, TypeError, KeyError) as error:
            raise OutputError(f"{path} is no trace: its first line is something else; {valid}") from error
        if kind != "trace" or version != VERSION:
            raise OutputError(f"{path}: kind {shown(kind)}, version {shown(version)}; {valid}")
        content = file.read()
    try:
        n_cars, n_arms = int(header["cars"]), int(header["arms"])
        if n_cars < 0 or n_arms < 0 or n_cars + n_arms > MOST_ROBOTS:
            raise ValueError(f"{n_cars} cars, {n_arms} arms")
        digests, marks, changes = _blocks(content, n_cars + n_arms)
        plan = _rows(header["plan"])
        cells = changes["value"][changes["quantity"] == Quantity.CELL]
        if ((cells >= len(plan) * len(plan[0])) | ((cells < -1) & (cells != UNKNOWN))).any():
            raise ValueError("a cell beyond the plan")
        return Trace(
            run=str(header["run"]),
            tick_s=_positive(header["tick_s"]),
            n_cars=n_cars,
            n_arms=n_arms,
            plan=plan,
            cell_m=_positive(header["cell_m"]),
            stations=tuple(map(str, header["stations"])),
            places=tuple(map(str, header["places"])),
            place_cells=_cells(header.get("place_cells", ()), len(plan) * len(plan[0])),
            phases=tuple(map(str, header["phases"])),
            arm_states=tuple(map(str, header["arm_states"])),
            digests=digests,
            marks=marks,
            changes=changes,
        )
    except (KeyError, TypeError, ValueError, OverflowError) as error:
        raise OutputError(f"{path}: cannot be read ({type(error).__name__}: {shown(str(error))}); {valid}") from error


def _positive(value: Any) -> float:
    if not 0.0 < float(value) < float("inf"):
        raise ValueError(f"{value!r} is not positive")
    return float(value)


def _cells(value: Any, n_cells: int) -> tuple[int, ...]:
    """Cells of a floor."""
    cells = tuple(map(int, value))
    if not all(0 <= cell < n_cells for cell in cells):
        raise ValueError("a place beyond the plan")
    return cells


def _rows(value: Any) -> tuple[str, ...]:
    """Rows of a drawing, which are of one length."""
    rows = tuple(map(str, value))
    if not rows or not rows[0] or any(len(row) != len(rows[0]) for row in rows):
        raise ValueError("the plan has no rows of one length")
    return rows


def _blocks(content: bytes, n_robots: int) -> tuple[npt.NDArray[Any], npt.NDArray[Any], npt.NDArray[Any]]:
    """Digests, marks and changes of all blocks; a last one that was cut off is left out.

    Raises:
        ValueError: A change is of no robot, quantity or tick.
    """
    digests, marks, changes = [np.zeros(0, _DIGEST)], [np.zeros((0, n_robots), _MARK)], [np.zeros(0, CHANGE)]
    at = 0
    while len(content) - at >= _SIZES.size:
        n_block_ticks, n_changes = _SIZES.unpack_from(content, at)
        sizes = (
            n_block_ticks * _DIGEST.itemsize,
            n_block_ticks * n_robots * _MARK.itemsize,
            n_changes * CHANGE.itemsize,
        )
        at += _SIZES.size
        if len(content) - at < sum(sizes):
            break
        digests.append(np.frombuffer(content, _DIGEST, n_block_ticks, at))
        marks.append(
            np.frombuffer(content, _MARK, n_block_ticks * n_robots, at + sizes[0]).reshape(n_block_ticks, n_robots)
        )
        changes.append(np.frombuffer(content, CHANGE, n_changes, at + sizes[0] + sizes[1]))
        at += sum(sizes)
    table = np.concatenate(changes)
    n_ticks = sum(map(len, digests))
    wrong = (table["robot"] >= n_robots) | (table["quantity"] >= len(Quantity))
    if wrong.any() or (np.diff(table["tick"], prepend=0, append=max(0, n_ticks - 1)) < 0).any():
        raise ValueError("changes of what there is not")
    return np.concatenate(digests), np.concatenate(marks), table


def _name(names: Sequence[str], index: int) -> str:
    return names[index] if 0 <= index < len(names) else f"number {index}"


@njit(cache=True)
def _mix(hashed: np.uint64, word: np.uint64) -> np.uint64:
    """One round of FNV-1a on 64-bit words, with a shift, as its product moves bits only upwards.

    Source: G. Fowler, L. C. Noll, K.-P. Vo, "The FNV Non-Cryptographic Hash Algorithm", RFC 9923.
    """
    hashed = (hashed ^ word) * np.uint64(0x100000001B3)
    return hashed ^ (hashed >> np.uint64(32))


@njit(cache=True)
def _digest(
    first: int,
    values: IntArray,
    motion: FloatArray,
    known: IntArray,
    digests: npt.NDArray[np.uint64],
    marks: npt.NDArray[np.uint16],
    changes: npt.NDArray[np.void],
) -> int:
    """Digest of each tick, marks of each robot, and rows for what has changed; returns how many rows."""
    n_ticks, n_quantities, n_robots = values.shape
    bits = (motion + 0.0).view(np.uint64)  # + 0.0: no negative zeros
    changed = 0
    for k in range(n_ticks):
        whole = np.uint64(0xCBF29CE484222325)
        for robot in range(n_robots):
            own = np.uint64(0xCBF29CE484222325)
            for number in range(bits.shape[2]):
                own = _mix(own, bits[k, robot, number])
            marks[k, robot] = np.uint16((own ^ (own >> np.uint64(16))) & np.uint64(0xFFFF))
            whole = _mix(whole, own)
            for quantity in range(n_quantities):
                value = values[k, quantity, robot]
                if value != known[quantity, robot]:
                    known[quantity, robot] = value
                    whole = _mix(_mix(whole, np.uint64(value)), np.uint64(n_quantities * robot + quantity))
                    row = changes[changed]
                    row.tick = first + k
                    row.robot = robot
                    row.quantity = quantity
                    row.value = value
                    changed += 1
        digests[k] = whole
    return changed
