"""Allocation of tasks to vehicles: the problem, the referee, and one file per allocator."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

from planners.registry import NO_SETTINGS, Family

if TYPE_CHECKING:
    from planners.allocation.problem import Allocator

ALLOCATORS: Family[Allocator] = Family(
    "allocator",
    "allocate(problem) -> Assignment",
    {
        "greedy": "planners.allocation.greedy.Greedy",
        "hungarian": "planners.allocation.hungarian.Hungarian",
        "fifo": "planners.allocation.fifo.Fifo",
        "auction": "planners.allocation.auction.Auction",
        "cbba": "planners.allocation.cbba.Cbba",
        "regret_lns": "planners.allocation.regret_lns.RegretLns",
        "apparent_tardiness": "planners.allocation.apparent_tardiness.ApparentTardiness",
        "cpsat": "planners.allocation.cpsat.CpSat",
    },
)
"""Allocator by name."""


def allocator_named(name: str, settings: Mapping[str, object] = NO_SETTINGS, *, what: str = "allocator") -> Allocator:
    """Make an allocator.

    Args:
        name: A name in `ALLOCATORS`, or `package.module.Class` of a class like `Allocator`.
        settings: Fields of the allocator's settings, by name; the others keep their defaults.
        what: What chose the name, for messages.

    Raises:
        MemberError: There is no such allocator, or it cannot be made; says the valid choices.
        SettingError: It has no such setting, or the setting takes another kind of value; says what is valid.
        PlanningError: A setting is out of its range.
    """
    from planners.allocation.checked import CheckedAllocator

    allocator = ALLOCATORS.make(name, settings, what=what)
    return allocator if name in ALLOCATORS else CheckedAllocator(name, allocator)
