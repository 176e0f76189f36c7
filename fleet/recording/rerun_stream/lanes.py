"""StateLanes: which state each robot and each task is in, over time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
import rerun as rr

from fleet.recording.frame import Frame
from fleet.recording.index import index_of
from fleet.recording.rerun_stream import palette
from fleet.recording.rerun_stream.columns import Chunks, offsets_of, values

STATES = "states"
"""Parent of all lanes."""
FEW_ROBOTS = 10
"""Up to so many robots each has an entity of its own, with its name over the lane."""
_LANES_TOGETHER = 5
"""Lanes of one entity where there are more: each entity costs 4 kB of file, and 0.2 ms where a lane changes."""


@dataclass(kw_only=True)
class _Group:
    """Lanes that are one entity; a row has the states of all of them."""

    path: str
    configured: tuple[str, ...]
    """Words that have a colour; others may look alike."""
    now: list[str]
    rows: list[tuple[Frame, list[str]]] = field(default_factory=list)
    """Changes that are not written yet, at most one per frame."""

    def change(self, frame: Frame, slot: int, state: str) -> None:
        """Put one lane into a state."""
        if not self.rows or self.rows[-1][0] is not frame:
            self.rows.append((frame, list(self.now)))
        self.rows[-1][1][slot] = self.now[slot] = state


class StateLanes:
    """Writes states where they change.

    Args:
        rec: The open recording.
        chunks: Takes the rows of a batch.
        n_robots: Cars and arms.
    """

    def __init__(self, rec: rr.RecordingStream, chunks: Chunks, n_robots: int) -> None:
        self._rec = rec
        self._chunks = chunks
        self._lanes_together = 1 if n_robots <= FEW_ROBOTS else _LANES_TOGETHER
        self._groups: list[_Group] = []
        self._lane: dict[str, tuple[_Group, int]] = {}
        self._words: dict[str, tuple[str, ...] | None] = {"car": None, "arm": None}

    def write(self, frames: Sequence[Frame]) -> None:
        """Append what changed in some frames."""
        for frame in frames:
            # Whoever makes the frames hands over the same tuples until a word changes.
            for kind, words in (("car", frame.car_state), ("arm", frame.arm_state)):
                before = self._words[kind]
                if words is not before:
                    self._words[kind] = words
                    new = [k for k, word in enumerate(words) if before is None or word != before[k]]
                    self._take(frame, f"{kind}s", {f"{kind}_{k}": words[k] for k in new})
            if frame.task_state:
                self._take(frame, "tasks", frame.task_state)
        for group in self._groups:
            if group.rows:
                self._send(group)

    def _take(self, frame: Frame, kind: str, states: Mapping[str, str]) -> None:
        new = [name for name in states if f"{kind}/{name}" not in self._lane]
        for first in range(0, len(new), self._lanes_together):
            self._open(frame, kind, {name: states[name] for name in new[first : first + self._lanes_together]})
        for name, state in states.items():
            group, slot = self._lane[f"{kind}/{name}"]
            if group.now[slot] != state:
                group.change(frame, slot, state)

    def _open(self, frame: Frame, kind: str, states: Mapping[str, str]) -> None:
        """Begin lanes that are one entity."""
        group = _Group(
            path=f"{STATES}/{kind}/{title(list(states))}",
            configured=palette.STATES_OF[kind],
            now=list(states.values()),
        )
        group.rows.append((frame, list(group.now)))
        self._groups.append(group)
        self._lane |= {f"{kind}/{name}": (group, slot) for slot, name in enumerate(states)}
        self._configure(group)

    def _configure(self, group: _Group) -> None:
        colours = np.array([palette.state_colour(state) for state in group.configured], np.uint32)
        style = rr.StateConfiguration(values=group.configured, colors=colours)
        self._rec.log(group.path, style, static=True)

    def _send(self, group: _Group) -> None:
        frames, states = zip(*group.rows, strict=True)
        group.rows.clear()
        unknown = {state for row in states for state in row}.difference(group.configured)
        if unknown:
            group.configured += tuple(sorted(unknown))
            self._configure(group)
        offsets = offsets_of([len(row) for row in states])
        column = values("StateChange:state", [state for row in states for state in row], offsets)
        self._chunks.add(group.path, index_of(frames), [column])


def title(names: Sequence[str]) -> str:
    """Name of an entity that holds some lanes: the first and the last of them."""
    return names[0] if len(names) == 1 else f"{names[0]}..{names[-1]}"


def car_paths(first: int, last: int) -> list[str]:
    """Entities of the lanes of the cars `first` to `last` of a run with more than `FEW_ROBOTS` robots."""
    begins = range(first, last + 1, _LANES_TOGETHER)
    return [title([f"car_{k}" for k in range(begin, min(begin + _LANES_TOGETHER, last + 1))]) for begin in begins]
