"""Allocation of tasks to vehicles: the problem, the referee, and one file per allocator."""

from planners.allocation.greedy import Greedy as Greedy
from planners.allocation.hungarian import Hungarian as Hungarian
from planners.allocation.problem import Allocator

ALLOCATORS: dict[str, type[Allocator]] = {"greedy": Greedy, "hungarian": Hungarian}
"""Allocator by name; each is made without arguments and has `allocate(problem) -> Assignment`."""
