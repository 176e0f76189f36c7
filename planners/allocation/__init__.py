"""Allocation of tasks to vehicles: the problem, the referee, and one file per allocator."""

import importlib
from typing import cast

from planners.allocation.auction import Auction as Auction
from planners.allocation.cbba import Cbba as Cbba
from planners.allocation.cpsat import CpSat as CpSat
from planners.allocation.fifo import Fifo as Fifo
from planners.allocation.greedy import Greedy as Greedy
from planners.allocation.hungarian import Hungarian as Hungarian
from planners.allocation.problem import Allocator
from planners.allocation.regret_lns import RegretLns as RegretLns
from planners.errors import PlanningError

ALLOCATORS: dict[str, type[Allocator]] = {
    "greedy": Greedy,
    "hungarian": Hungarian,
    "fifo": Fifo,
    "auction": Auction,
    "cbba": Cbba,
    "regret_lns": RegretLns,
    "cpsat": CpSat,
}
"""Allocator by name; each is made without arguments and has `allocate(problem) -> Assignment`."""


class AllocatorError(PlanningError):
    """No allocator has that name."""


def allocator_named(name: str) -> Allocator:
    """Make an allocator.

    Args:
        name: A name in `ALLOCATORS`, or `package.module.Class` of a class that is made without arguments and has
            `allocate(problem) -> Assignment`.

    Raises:
        AllocatorError: There is no such allocator, or it cannot be made; names the valid choices.
    """
    if name in ALLOCATORS:
        return ALLOCATORS[name]()
    module, _, kind = name.rpartition(".")
    valid = f"{', '.join(ALLOCATORS)}, or package.module.Class"
    if not (module and kind):
        raise AllocatorError(f"allocator {name!r}: no such name; valid: {valid}")
    try:
        made = getattr(importlib.import_module(module), kind)()
    except (ImportError, ValueError, AttributeError, TypeError) as error:
        raise AllocatorError(f"allocator {name!r}: {str(error).splitlines()[0]}; valid: {valid}") from error
    if not callable(getattr(made, "allocate", None)):
        raise AllocatorError(f"allocator {name!r}: it has no method allocate(problem); valid: {valid}")
    return cast(Allocator, made)
