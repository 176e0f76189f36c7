"""Right of way: moves that agents wish for become moves that can be made together, in any order and at any speed."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from numba import njit

from fleet.envs.grid.kernel import NONE, Bools, Ints

_UNDECIDED, _GOES, _STAYS, _ASKED = 0, 1, 2, 3


@njit(cache=True, nogil=True)
def resolve_moves(
    state: Ints,
    wanted: Ints,
    order: npt.NDArray[np.int64],
    state_cell: Ints,
    occupant: Ints,
    claimant: Ints,
    after: Ints,
) -> None:  # pragma: no cover - compiled
    """Say where every car goes in a timestep.

    Of cars that wish to enter one cell the first in the order may; the others stay. A car follows into a cell that is
    vacated in the same timestep; where the car ahead stays, all that follow it stay. A closed ring of followers stays,
    two cars that would change places included, because no car in it could begin.

    Whatever is wished for, the result is legal: one car per cell, no swap, no ring.

    Args:
        state: State of each car, shape (n,), in distinct cells.
        wanted: State that each wishes to be in, its own to stay; else one that a move leads to, shape (n,).
        order: Cars, the one that goes first in front, shape (n,).
        state_cell: Cell of each state.
        occupant: `NONE` for every cell, before and after the call.
        claimant: The same.
        after: Receives the states after the timestep, shape (n,).
    """
    n = len(state)
    status = np.zeros(n, dtype=np.int8)
    stack = np.empty(n, dtype=np.int64)
    for car in range(n):
        occupant[state_cell[state[car]]] = car
    for car in order:
        to = state_cell[wanted[car]]
        if wanted[car] == state[car] or claimant[to] != NONE:
            status[car] = _STAYS
        else:
            claimant[to] = car
    for first in range(n):
        depth, car = 0, first
        outcome = _UNDECIDED
        while outcome == _UNDECIDED:
            if status[car] == _ASKED:
                outcome = _STAYS  # the chain has come back to itself
            elif status[car] != _UNDECIDED:
                outcome = status[car]
            else:
                status[car] = _ASKED
                stack[depth] = car
                depth += 1
                ahead = occupant[state_cell[wanted[car]]]
                if ahead == NONE:
                    outcome = _GOES
                else:
                    car = ahead
        for k in range(depth):
            status[stack[k]] = outcome
    for car in range(n):
        after[car] = wanted[car] if status[car] == _GOES else state[car]
        occupant[state_cell[state[car]]] = NONE
        claimant[state_cell[wanted[car]]] = NONE


class RightOfWay:
    """`resolve_moves` with its working memory.

    Args:
        state_cell: Cell of each state, shape (n_states,).
        n_cells: Cells of the floor.
    """

    def __init__(self, state_cell: Ints, n_cells: int) -> None:
        self._state_cell = state_cell
        self._occupant = np.full(n_cells, NONE, dtype=np.int32)
        self._claimant = self._occupant.copy()

    def resolve(self, state: Ints, wanted: Ints, priority: npt.NDArray[np.float64], locked: Bools) -> Ints:
        """Say where every car goes in a timestep.

        Args:
            state: State of each car, shape (n,), in distinct cells.
            wanted: State that each wishes to be in, its own to stay, shape (n,).
            priority: Larger goes first, of equal ones the lower index, shape (n,).
            locked: Cars that do not move, shape (n,).
        """
        after = np.empty_like(state)
        order = np.argsort(-priority, kind="stable")
        wished = np.where(locked, state, wanted).astype(np.int32)
        resolve_moves(state, wished, order, self._state_cell, self._occupant, self._claimant, after)
        return after
