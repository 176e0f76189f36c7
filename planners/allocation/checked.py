"""Checked: an allocator of one's own, whose answers the referee looks at, because nobody else has."""

from __future__ import annotations

import numpy as np

from planners.allocation.problem import AllocationProblem, Allocator, Assignment
from planners.allocation.validate import faults
from planners.errors import PlanningError
from planners.registry import told


class AllocationFault(PlanningError):
    """An allocator of one's own gave an answer that is not legal."""


class CheckedAllocator:
    """An allocator of one's own.

    Args:
        name: What it is called in messages.
        allocator: The allocator; what it says of itself holds here too.
    """

    def __init__(self, name: str, allocator: Allocator) -> None:
        self.plans_ahead = bool(getattr(allocator, "plans_ahead", False))
        self.soon_s = float(getattr(allocator, "soon_s", 0.0))
        self._name = name
        self._allocator = allocator

    def allocate(self, problem: AllocationProblem) -> Assignment:
        """Allocate.

        Raises:
            AllocationFault: There is no answer, or it is no `Assignment`, or not a legal one.
        """
        try:
            found = self._allocator.allocate(problem)
        except PlanningError:
            raise
        except Exception as error:
            what = told(error, type(self._allocator).__module__)
            raise AllocationFault(f"allocator {self._name!r}: {what}; valid: an Assignment without faults") from error
        if wrong := _wrong(problem, found):
            raise AllocationFault(f"allocator {self._name!r}: its answer {wrong}; valid: an Assignment without faults")
        return found


def _wrong(problem: AllocationProblem, found: object) -> str:
    """What keeps an answer from being a legal assignment, empty if nothing does."""
    if not isinstance(found, Assignment):
        return f"is of type {type(found).__name__}"
    pairs = found.pairs
    if not (isinstance(pairs, np.ndarray) and pairs.ndim == 2 and pairs.shape[1] == 2 and pairs.dtype.kind in "iu"):
        return f"has the pairs {' '.join(repr(pairs).split())[:60]}, not integers of shape (k, 2)"
    wrong = faults(problem, found)
    if not wrong:
        return ""
    return f"has {wrong[0].kind} for vehicle and task {wrong[0].pair}" if wrong[0].pair else f"has {wrong[0].kind}"
