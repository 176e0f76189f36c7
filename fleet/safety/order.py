"""OrderCheck: whether all moves that wait can be made one after another, or some wait for each other in a ring.

Moves that wait are the nodes of a graph. A move comes before the next one of its car; at each cell, before the next one
in the cell's line; and the first one of a car that stands in a cell comes before all others that lead through it. The
graph is acyclic if its nodes can be taken away one after another, each when nothing is left before it.

Source: A. B. Kahn, "Topological sorting of large networks", Communications of the ACM 5(11), 1962.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from fleet.arrays import CellArray, IntArray
from fleet.run.view import RunView
from fleet.safety.breach import Breach, Invariant
from planners.precedence.queues import Queues

_RING, _BROKEN_LINE = 1, 2


class OrderCheck:
    """The order in which cars come through cells.

    Args:
        run: The run.
    """

    def __init__(self, run: RunView) -> None:
        self._run = run
        self._dependencies = run.executor.dependencies

    def look(self) -> Breach | None:
        """Find out whether a car waits for itself in the end."""
        queues = self._dependencies.queues
        fault, cars, cell = _stuck(queues)
        if not fault:
            return None
        ring = list(dict.fromkeys(cars.tolist()))
        grid = self._run.site.grid
        robots = tuple(f"car_{car}" for car in ring)
        if fault == _BROKEN_LINE:
            place = "{},{}".format(*grid.row_col(cell))
            words, valid = f"the line of cell {place} has a visit that is no waiting move", "one visit for each"
        else:
            place, valid = "", "an order in which every waiting move can be made"
            words = f"{', '.join(robots)} wait for each other in a ring"
        waits = {
            f"car_{car}": [
                f"car_{other} at {'{},{}'.format(*grid.row_col(at))}" for other, at in self._dependencies.blockers(car)
            ]
            for car in ring
        }
        return Breach(
            invariant=Invariant.ORDER, words=words, valid=valid, robots=robots, place=place, values={"waits_for": waits}
        )


@njit(cache=True)
def _stuck(q: Queues) -> tuple[int, CellArray, int]:  # pragma: no cover - compiled
    """What is wrong with the order (0 = nothing), the cars that it is about, and a cell, -1 for none."""
    n = len(q.state)
    nobody = np.empty(0, np.int32)
    first = np.zeros(n + 1, np.int64)  # node of each car's first waiting move
    for car in range(n):
        first[car + 1] = first[car] + q.queued[car] - q.granted[car]
    n_nodes = first[n]
    if n_nodes == 0:
        return 0, nobody, -1
    car_of = np.empty(n_nodes, np.int32)
    n_lines = np.zeros(n_nodes, np.int64)  # lines in which a move has its visit
    n_visits = 0
    for car in range(n):
        for k in range(first[car], first[car + 1]):
            car_of[k] = car
            move = q.moves[car, (q.granted[car] + k - first[car]) % q.moves.shape[1]]
            n_visits += q.swept_ptr[move + 1] - q.swept_ptr[move]
    stands = np.full(len(q.holder), -1, np.int32)
    for car in range(n):
        state = q.state[car]
        if q.granted[car] > q.finished[car]:
            state = q.move_to[q.moves[car, (q.granted[car] - 1) % q.moves.shape[1]]]
        stands[q.state_cell[state]] = car

    before = np.empty(2 * n_visits + n_nodes, np.int64)
    after = np.empty(2 * n_visits + n_nodes, np.int64)
    n_edges = 0
    for car in range(n):
        for k in range(first[car], first[car + 1] - 1):
            before[n_edges], after[n_edges] = k, k + 1
            n_edges += 1
    n_seen = 0
    for cell in range(len(q.line_first)):
        last, visit = -1, q.line_first[cell]
        keeper = stands[cell]
        if keeper >= 0 and first[keeper] == first[keeper + 1]:
            keeper = -1
        while visit >= 0:
            car, number = q.visit_agent[visit], q.visit_number[visit]
            n_seen += 1
            if n_seen > n_visits or not q.granted[car] <= number < q.queued[car]:
                return _BROKEN_LINE, np.full(1, car, np.int32), cell
            node = first[car] + number - q.granted[car]
            n_lines[node] += 1
            if last >= 0:
                before[n_edges], after[n_edges] = last, node
                n_edges += 1
            if keeper >= 0 and keeper != car:
                before[n_edges], after[n_edges] = first[keeper], node
                n_edges += 1
            last, visit = node, q.visit_next[visit]
    for node in range(n_nodes):
        car = car_of[node]
        move = q.moves[car, (q.granted[car] + node - first[car]) % q.moves.shape[1]]
        if n_lines[node] != q.swept_ptr[move + 1] - q.swept_ptr[move]:
            return _BROKEN_LINE, np.full(1, car, np.int32), q.swept_cell[q.swept_ptr[move]]
    ring = _ring(before[:n_edges], after[:n_edges], n_nodes)
    return (_RING, car_of[ring], -1) if len(ring) else (0, nobody, -1)


@njit(cache=True)
def _ring(before: IntArray, after: IntArray, n_nodes: int) -> IntArray:  # pragma: no cover - compiled
    """Nodes of a ring among edges from `before` to `after`, (k,), k = 0 if there is none."""
    n_before = np.zeros(n_nodes, np.int64)
    begin = np.zeros(n_nodes + 1, np.int64)
    for edge in range(len(before)):
        n_before[after[edge]] += 1
        begin[before[edge] + 1] += 1
    for node in range(n_nodes):
        begin[node + 1] += begin[node]
    following = np.empty(len(before), np.int64)
    at = begin[:-1].copy()
    for edge in range(len(before)):
        following[at[before[edge]]] = after[edge]
        at[before[edge]] += 1
    free = np.empty(n_nodes, np.int64)
    n_free, n_taken = 0, 0
    for node in range(n_nodes):
        if n_before[node] == 0:
            free[n_free] = node
            n_free += 1
    while n_taken < n_free:
        node = free[n_taken]
        n_taken += 1
        for k in range(begin[node], begin[node + 1]):
            n_before[following[k]] -= 1
            if n_before[following[k]] == 0:
                free[n_free] = following[k]
                n_free += 1
    if n_free == n_nodes:
        return free[:0]
    # Whatever is left has something left before it: going back from anywhere leads into a ring.
    left = n_before > 0
    comes_from = np.zeros(n_nodes, np.int64)
    for edge in range(len(before)):
        if left[before[edge]] and left[after[edge]]:
            comes_from[after[edge]] = before[edge]
    node = int(np.argmax(left))
    for _ in range(n_nodes):
        node = comes_from[node]
    ring, n_ring, start = free, 0, node
    while n_ring == 0 or node != start:
        ring[n_ring] = node
        n_ring += 1
        node = comes_from[node]
    return ring[:n_ring]
