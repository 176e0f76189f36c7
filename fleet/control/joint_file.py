"""JointRecording: a measured joint motion, as a CSV file has it."""

from __future__ import annotations

import csv
import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from fleet.arrays import FloatArray
from fleet.control.errors import ControlError
from fleet.control.limits import JointLimits

SHORTEST_S, LONGEST_S = 0.1, 3600.0
"""A motion that tells something, and that is replayed in minutes."""
LEAST_ROWS = 5
"""Fewer rows say nothing about friction."""
BEYOND_RAD = 0.1
"""An encoder may be off by this much, and a set-point may lie this far beyond the limits [rad]."""
TOO_FAST = 1.5
"""Ratio to the greatest speed above which a joint cannot have moved so far, besides `BEYOND_RAD`."""


class RecordingFileError(ControlError):
    """A file does not hold a joint motion of the arm."""


@dataclass(frozen=True, kw_only=True, eq=False)
class JointRecording:
    """What the joints of an arm were measured to do."""

    t: FloatArray
    """Times [s], increasing, shape (k,)."""
    q: FloatArray
    """Joint positions [rad], shape (k, n)."""
    target: FloatArray | None = None
    """Set-points that were sent to the arm [rad], shape (k, n); None if they are not known."""


def read_recording(path: Path, n_joints: int) -> JointRecording:
    """Read a motion: columns time, q1 to qn, and optionally target1 to targetn; a first line of names may be there.

    Args:
        path: The file.
        n_joints: Joints of the arm.

    Raises:
        RecordingFileError: The file's name and line, what is wrong, and what would be right.
    """
    if not path.is_file():
        raise RecordingFileError(f"{path}: no such file; valid: a CSV file with time, q1 to q{n_joints}")
    rows: list[list[float]] = []
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            for cells in (reader := csv.reader(file)):
                words = [cell.strip() for cell in cells]
                if not any(words) or words[0].startswith("#"):
                    continue
                where = f"{path}, line {reader.line_num}"
                if not rows and words[0].lower() in ("time", "t"):
                    _check_names(where, words, n_joints)
                    continue
                rows.append(_numbers(where, words, n_joints, rows[-1] if rows else None))
    except (UnicodeDecodeError, csv.Error) as reason:
        raise RecordingFileError(f"{path}: not a text file with commas ({reason})") from reason
    if len(rows) < LEAST_ROWS:
        raise RecordingFileError(f"{path}: {len(rows)} rows of numbers; valid: at least {LEAST_ROWS}")
    table = np.array(rows)
    return JointRecording(
        t=table[:, 0] - table[0, 0],
        q=table[:, 1 : n_joints + 1],
        target=table[:, n_joints + 1 :] if table.shape[1] > n_joints + 1 else None,
    )


def check_recording(path: Path, recording: JointRecording, limits: JointLimits) -> None:
    """Refuse a motion that the arm cannot have made, such as one in degrees.

    Args:
        path: Where it was read.
        recording: The motion.
        limits: Of the arm.

    Raises:
        RecordingFileError: Time and joint that are outside the limits, or that jump, or a time that is not in seconds.
    """
    if not SHORTEST_S <= recording.t[-1] <= LONGEST_S:
        raise RecordingFileError(
            f"{path}: the motion lasts {recording.t[-1]:g} s; valid: {SHORTEST_S:g} to {LONGEST_S:g} s"
        )
    for name, rows in (("q", recording.q), ("target", recording.target)):
        if rows is None:
            continue
        outside = (rows < limits.lower_rad - BEYOND_RAD) | (rows > limits.upper_rad + BEYOND_RAD)
        if outside.any():
            k, i = np.argwhere(outside)[0]
            raise RecordingFileError(
                f"{path}: {name}{i + 1} is {rows[k, i]:g} rad at {recording.t[k]:g} s; "
                f"valid: {limits.lower_rad[i]:.4g} to {limits.upper_rad[i]:.4g} rad (not degrees)"
            )
    dt = np.diff(recording.t)[:, None]
    jumps = np.abs(np.diff(recording.q, axis=0)) > TOO_FAST * limits.max_velocity_radps * dt + BEYOND_RAD
    if jumps.any():
        k, i = np.argwhere(jumps)[0]
        raise RecordingFileError(
            f"{path}: q{i + 1} goes from {recording.q[k, i]:g} to {recording.q[k + 1, i]:g} rad within "
            f"{dt[k, 0]:g} s, at {recording.t[k]:g} s; valid: at most {limits.max_velocity_radps[i]:.4g} rad/s"
        )


def write_recording(path: Path, recording: JointRecording) -> None:
    """Write a motion so that `read_recording` reads the same, up to a nanosecond and a nanoradian."""
    n = recording.q.shape[1]
    names = ["time", *(f"q{i + 1}" for i in range(n))]
    columns = [recording.t[:, None], recording.q]
    if recording.target is not None:
        names += [f"target{i + 1}" for i in range(n)]
        columns.append(recording.target)
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(names)
        writer.writerows([f"{value:.9g}" for value in row] for row in np.concatenate(columns, axis=1).tolist())


def _check_names(where: str, words: list[str], n: int) -> None:
    wanted = [["time", "t"], *([f"q{i + 1}"] for i in range(n)), *([f"target{i + 1}"] for i in range(n))]
    if len(words) not in (n + 1, 2 * n + 1):
        raise RecordingFileError(f"{where}: {len(words)} columns; valid: {_widths(n)}")
    for word, names in zip(words, wanted, strict=False):
        if word.lower() not in names:
            raise RecordingFileError(f"{where}: column {word!r}; valid: {names[0]!r} in its place")


def _numbers(where: str, words: list[str], n: int, before: list[float] | None) -> list[float]:
    """A row of numbers."""
    valid = (n + 1, 2 * n + 1) if before is None else (len(before),)
    if len(words) not in valid:
        need = _widths(n) if before is None else f"{len(before)} as in the rows above"
        raise RecordingFileError(f"{where}: {len(words)} columns; valid: {need}")
    row = []
    for i, word in enumerate(words):
        try:
            value = float(word)
        except ValueError:
            value = math.nan
        if not math.isfinite(value):
            raise RecordingFileError(f"{where}: column {i + 1} is {word!r}; valid: a finite number")
        row.append(value)
    if before is not None and row[0] <= before[0]:
        raise RecordingFileError(f"{where}: time {row[0]:g} s after {before[0]:g} s; valid: increasing times")
    return row


def _widths(n: int) -> str:
    return f"{n + 1} (time, q1 to q{n}), or {2 * n + 1} with target1 to target{n}, for an arm of {n} joints"
