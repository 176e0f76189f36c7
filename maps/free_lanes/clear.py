"""Clear places: cars stand only where nobody has to come past them who does not want to go there."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

Bools = npt.NDArray[np.bool_]


@dataclass(frozen=True, kw_only=True)
class ClearWay:
    """A move between two places."""

    begin: int
    end: int
    parts: tuple[int, ...]
    """The moves that it was made of, one after the other."""
    beside: frozenset[int]
    """Places at which a car would touch it, but for its ends."""


def clear_ways(ends: list[tuple[int, int]], touch: Bools, kept: set[int]) -> list[ClearWay]:
    """Join moves at places in which a car would stand in the way of others, so that nobody stops there.

    A car that stands in a place blocks those that want to go there, as on any lane graph. If it blocked others too, two
    of them could block each other for ever. The place that is in most ways goes first.

    Args:
        ends: Begin and end of each move.
        touch: Whether a car touches each move at each place, shape (n_moves, n_places).
        kept: Places that have to stay.

    Returns:
        Moves between the places that are left, none from a place to itself.
    """
    ways = [
        ClearWay(begin=begin, end=end, parts=(k,), beside=frozenset(np.flatnonzero(touch[k]).tolist()) - {begin, end})
        for k, (begin, end) in enumerate(ends)
    ]
    while True:
        n_in_the_way = np.zeros(touch.shape[1], dtype=np.int64)
        for way in ways:
            n_in_the_way[list(way.beside - kept)] += 1
        if not n_in_the_way.any():
            return ways
        ways = _without(ways, int(n_in_the_way.argmax()))


def _without(ways: list[ClearWay], place: int) -> list[ClearWay]:
    """Moves that lead through a place instead of to it and from there."""
    found = [way for way in ways if place not in (way.begin, way.end)]
    for into in (way for way in ways if way.end == place):
        for onward in (way for way in ways if way.begin == place):
            if into.begin != onward.end:
                beside = (into.beside | onward.beside) - {into.begin, onward.end}
                joined = into.parts + onward.parts
                found.append(ClearWay(begin=into.begin, end=onward.end, parts=joined, beside=beside))
    return [replace(way, beside=way.beside - {place}) if place in way.beside else way for way in found]
