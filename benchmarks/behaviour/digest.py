"""Digest: the lines that a case leaves become short digests, and two digests tell where their lines part."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

MOST_MARKS = 128
"""Groups that the lines of a part are split into at most, to find out later where two parts differ."""
_MARK = 2
"""Hexadecimal digits of a mark."""


@dataclass(frozen=True, kw_only=True)
class Digest:
    """A part of a case, such as the events of a run, without its text."""

    digest: str
    """Of all lines."""
    lines: int
    every: int
    """Lines in a group, but for the last one."""
    marks: str
    """Two hexadecimal digits for each group of lines."""

    @staticmethod
    def of(lines: Sequence[str], every: int | None = None) -> Digest:
        """The digest of some lines.

        Args:
            lines: Without their ends.
            every: Lines in a group; None = as few as give no more than `MOST_MARKS` groups.
        """
        if every is None:
            every = max(1, -(-len(lines) // MOST_MARKS))
        groups = [lines[begin : begin + every] for begin in range(0, len(lines), every)]
        marks = "".join(_hash(group)[:_MARK] for group in groups)
        return Digest(digest=_hash(lines)[:16], lines=len(lines), every=every, marks=marks)

    @staticmethod
    def read(item: Mapping[str, Any]) -> Digest:
        """What `to_json` returned."""
        return Digest(**item)

    def to_json(self) -> dict[str, Any]:
        """Text and numbers by name."""
        return asdict(self)

    def first_difference(self, lines: Sequence[str]) -> str | None:
        """Where lines begin to be others than those of the digest; None if they are the same."""
        now = Digest.of(lines, self.every)
        if now.digest == self.digest:
            return None
        marks = [self.marks[k : k + _MARK] for k in range(0, len(self.marks), _MARK)]
        marks_now = [now.marks[k : k + _MARK] for k in range(0, len(now.marks), _MARK)]
        same = (before == after for before, after in zip(marks, marks_now, strict=False))
        group = next((k for k, alike in enumerate(same) if not alike), min(len(marks), len(marks_now)))
        count = "" if now.lines == self.lines else f" ({now.lines} lines instead of {self.lines})"
        begin, end = group * self.every, min((group + 1) * self.every, now.lines)
        if begin >= end:
            return f"nothing after line {now.lines}{count}"
        where = f"line {end}" if end == begin + 1 else f"lines {begin + 1} to {end}, which begin"
        return f"{where}{count}: {lines[begin][:200]}"


def differences(
    recorded: Mapping[str, Any], parts: Mapping[str, Sequence[str]], figures: Mapping[str, Any]
) -> list[str]:
    """What is not as it was recorded, part by part.

    Args:
        recorded: What `to_record` returned for the case when it was recorded.
        parts: The lines of each part now.
        figures: Those of the case now.
    """
    found = []
    known = recorded["parts"]
    for name in [*known, *(name for name in parts if name not in known)]:
        if name not in parts:
            found.append(f"{name}: is missing")
        elif name not in known:
            found.append(f"{name}: is new")
        elif (where := Digest.read(known[name]).first_difference(parts[name])) is not None:
            found.append(f"{name}: {where}")
    before = recorded["figures"]
    for name in [*before, *(name for name in figures if name not in before)]:
        if before.get(name) != figures.get(name):
            found.append(f"{name}: {figures.get(name)} instead of {before.get(name)}")
    return found


def to_record(parts: Mapping[str, Sequence[str]], figures: Mapping[str, Any]) -> dict[str, Any]:
    """What is kept of a case: digests of its parts, and its figures."""
    return {"figures": dict(figures), "parts": {name: Digest.of(lines).to_json() for name, lines in parts.items()}}


def _hash(lines: Sequence[str]) -> str:
    return hashlib.sha256("\n".join(lines).encode()).hexdigest()
