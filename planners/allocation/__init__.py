"""Allocation of tasks to vehicles: the problem, the referee, and one file per allocator."""

from planners.allocation.fifo import Fifo as Fifo
from planners.allocation.greedy import Greedy as Greedy
from planners.allocation.hungarian import Hungarian as Hungarian
from planners.allocation.problem import Allocator
from planners.allocation.regret_lns import RegretLns as RegretLns

ALLOCATORS: dict[str, type[Allocator]] = {
    "greedy": Greedy,
    "hungarian": Hungarian,
    "fifo": Fifo,
    "regret_lns": RegretLns,
}
"""Allocator by name; each is made without arguments and has `allocate(problem) -> Assignment`."""
