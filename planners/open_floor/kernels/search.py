"""Search: hybrid A* in space and time for one car among others that have their ways, with Reeds-Shepp ends.

A car drives a step straight or along its tightest curve to a side, forwards or backwards, or stands for a step. Poses
in one cell, of one of sixteen headings and at one time, count as one; fine rules, for narrow places, have short moves
besides and smaller cells. From poses near the goal, and now and then from
others, the shortest way to the goal on an empty floor is tried. To touch others costs what their ways are worth, so
that the search finds the way that disturbs least.

Source: D. Dolgov et al., "Practical Search Techniques in Path Planning for Autonomous Driving", 2008, for hybrid A*
with Reeds-Shepp ends; the cost of what is in the way is that of routing by negotiation: L. McMurchie and C. Ebeling,
"PathFinder: A Negotiation-Based Performance-Driven Router for FPGAs", 1995.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from planners.open_floor.arrays import FloatArray, IntArray
from planners.open_floor.kernels.body import CarBody
from planners.open_floor.kernels.floor import StaticFloor, cell_of, is_free
from planners.open_floor.kernels.kernel import kernel
from planners.open_floor.kernels.reeds_shepp import MOST_SEGMENTS, TABLE_RADII, shortest_way, tabulated_length, wrapped
from planners.open_floor.kernels.timetable import NEVER, WayTable, cars_near, touches

NO_NODE = -1
_STAND = 0
"""The move that stands."""
_HEADINGS = 16
_FINE = 4
"""Of fine rules: so many times shorter are the moves that there are besides, and the cells and headings of poses."""
_NEAR_RADII = 4.0
"""Ends are tried from all poses so near to the goal [turning radii] ..."""
_EVERY = 8
"""... and from every so many of those further off."""
_DETOUR, _DETOUR_RADII = 2.2, 5.0
"""Ends longer than this many times the distance, and so many turning radii, are not tried."""


class MoveRules(NamedTuple):
    """What moves are and what they cost; costs are in steps, and every move takes one."""

    radius: float
    step: float
    """Length of a move at full speed [m]."""
    cell: float
    """Poses count as one within a square of this side [m], if they are also ..."""
    headings: int
    """... within this part of a full turn."""
    checks: int
    margin: float
    weight: float
    turn_cost: float
    backwards_cost: float
    cusp_cost: float
    length: FloatArray
    """Of each move [m], negative backwards; the first stands. Shape (n_moves,)."""
    curvature: FloatArray
    """Of each move [1/m], positive to the left, shape (n_moves,)."""
    move: FloatArray
    """Pose of a car from the origin in each move at each check: x, y, cosine and sine of yaw, shape (n_moves, checks,
    4)."""


class SearchMemory(NamedTuple):
    """What a search writes into; made once, as long as the longest search needs it."""

    pose: FloatArray
    """x, y, yaw of each node, shape (n_nodes, 3)."""
    cost: FloatArray
    """Cost so far, and with what is expected to come, shape (n_nodes, 2)."""
    link: IntArray
    """Step, parent, move, and for an end its row in `end`, of each node, shape (n_nodes, 4)."""
    heap: IntArray
    seen: IntArray
    """Hash of keys of poses that have been looked at, -1 where free; its size is a power of 2."""
    end: FloatArray
    """Segments of each end, shape (n_ends, MOST_SEGMENTS, 2)."""
    end_length: IntArray
    near: IntArray
    """Cars near the pose that is looked at, shape (n_cars,)."""
    swept: FloatArray
    """Poses of the move that is looked at, shape (checks, 4)."""
    segments: FloatArray


class SearchQuery(NamedTuple):
    """What one search is about."""

    start: FloatArray
    goal: FloatArray
    distance: FloatArray
    """Of each cell from the goal [m], shape (n_across, n_up)."""
    curve: FloatArray
    """`length_table` of Reeds-Shepp curves."""
    worth: FloatArray
    """Cost of touching each car in a step, infinite for one that must not be touched, shape (n_cars,)."""
    visit: IntArray
    """Last sample at which each car touches somebody at the goal, shape (n_cars,)."""
    quiet_step: int
    """From then on nobody moves."""
    most: int
    """Poses that may be looked at."""


def rules_of(
    *,
    radius_m: float,
    step_m: float,
    checks: int,
    margin_m: float,
    weight: float,
    turn_cost: float,
    backwards_cost: float,
    cusp_cost: float,
    fine: bool,
) -> MoveRules:
    """Tabulate the moves of a car.

    Args:
        radius_m: Of its tightest curve.
        step_m: Length of a move.
        checks: Poses of a move that are looked at.
        margin_m: Kept between cars.
        weight: Of what is expected to come.
        turn_cost: Of a curve, more than of a straight line.
        backwards_cost: Of a move backwards, more than of one forwards.
        cusp_cost: Of a change between the two.
        fine: Whether there are short moves too, for narrow places.
    """
    lengths = step_m * np.array([1.0, -1.0, 1.0 / _FINE, -1.0 / _FINE][: 4 if fine else 2])
    length = np.concatenate([[0.0], np.repeat(lengths, 3)])
    curvature = np.concatenate([[0.0], np.tile([1.0, 0.0, -1.0], len(lengths))]) / radius_m
    done = length[:, None] * np.arange(1, checks + 1) / checks
    half = 0.5 * done * curvature[:, None]
    chord = done * np.sinc(half / np.pi)  # of an arc; sinc is sin(pi x) / (pi x)
    finer = _FINE if fine else 1
    return MoveRules(
        radius=radius_m,
        step=step_m,
        cell=radius_m / 3.0 / finer,
        headings=_HEADINGS * finer,
        checks=checks,
        margin=margin_m,
        weight=weight,
        turn_cost=turn_cost,
        backwards_cost=backwards_cost,
        cusp_cost=cusp_cost,
        length=length,
        curvature=curvature,
        move=np.stack([chord * np.cos(half), chord * np.sin(half), np.cos(2 * half), np.sin(2 * half)], axis=-1),
    )


def memory_for(most: int, n_cars: int, rules: MoveRules) -> SearchMemory:
    """Memory of searches that look at no more than so many poses."""
    n_nodes = most * (len(rules.length) + 1) + 1
    return SearchMemory(
        pose=np.empty((n_nodes, 3)),
        cost=np.empty((n_nodes, 2)),
        link=np.empty((n_nodes, 4), dtype=np.int64),
        heap=np.empty(n_nodes, dtype=np.int64),
        seen=np.empty(1 << (2 * most).bit_length(), dtype=np.int64),
        end=np.empty((most, MOST_SEGMENTS, 2)),
        end_length=np.empty(most, dtype=np.int64),
        near=np.empty(max(n_cars, 1), dtype=np.int64),
        swept=np.empty((rules.checks, 4)),
        segments=np.empty((MOST_SEGMENTS, 2)),
    )


@kernel
def search(
    query: SearchQuery, floor: StaticFloor, table: WayTable, body: CarBody, rules: MoveRules, memory: SearchMemory
) -> tuple[int, int, bool]:
    """Look for the way of a car that costs least.

    Returns:
        Node of the end, or `NO_NODE`; poses looked at; and whether those were all that can be reached.
    """
    seen, link, cost, pose = memory.seen, memory.link, memory.cost, memory.pose
    for k in range(len(seen)):
        seen[k] = -1
    for axis in range(3):
        pose[0, axis] = query.start[axis]
    link[0, 0], link[0, 1], link[0, 2], link[0, 3] = 0, NO_NODE, _STAND, NO_NODE
    cost[0, 0], cost[0, 1] = 0.0, 0.0
    memory.heap[0] = 0
    n_heap, n_nodes, n_ends, n_looked = 1, 1, 0, 0
    best_end = NO_NODE
    radius = table.reach + 2.0 * abs(body.centre)
    while n_heap > 0 and n_looked < query.most:
        node = _pop(memory.heap, n_heap, cost)
        n_heap -= 1
        if link[node, 3] != NO_NODE:
            return node, n_looked, False
        x, y, yaw, step = pose[node, 0], pose[node, 1], pose[node, 2], link[node, 0]
        if not _note(seen, _key(x, y, yaw, min(step, query.quiet_step), floor, rules)):
            continue
        n_looked += 1
        distance = math.hypot(query.goal[0] - x, query.goal[1] - y)
        if distance < _NEAR_RADII * rules.radius or n_looked % _EVERY == 1:
            more = _end_cost(query, node, n_ends, distance, floor, table, body, rules, memory)
            if more < math.inf:
                link[n_nodes, 0], link[n_nodes, 1], link[n_nodes, 2], link[n_nodes, 3] = step, node, _STAND, n_ends
                cost[n_nodes, 0] = cost[n_nodes, 1] = cost[node, 0] + more
                _push(memory.heap, n_heap, cost, n_nodes)
                if best_end == NO_NODE or cost[n_nodes, 0] < cost[best_end, 0]:
                    best_end = n_nodes
                n_heap, n_nodes, n_ends = n_heap + 1, n_nodes + 1, n_ends + 1
        n_near = cars_near(table, x, y, step, radius, memory.near)
        for move in range(len(rules.length)):
            more = _move_cost(query, node, move, n_near, floor, table, body, rules, memory)
            if more == math.inf:
                continue
            last = rules.checks - 1
            after_x, after_y = memory.swept[last, 0], memory.swept[last, 1]
            after_yaw = yaw + rules.length[move] * rules.curvature[move]
            after = cost[node, 0] + more
            left = _left(query, after_x, after_y, after_yaw, floor, rules)
            pose[n_nodes, 0], pose[n_nodes, 1], pose[n_nodes, 2] = after_x, after_y, after_yaw
            link[n_nodes, 0], link[n_nodes, 1], link[n_nodes, 2] = step + 1, node, move
            link[n_nodes, 3] = NO_NODE
            cost[n_nodes, 0], cost[n_nodes, 1] = after, after + rules.weight * left
            _push(memory.heap, n_heap, cost, n_nodes)
            n_heap, n_nodes = n_heap + 1, n_nodes + 1
    return best_end, n_looked, n_heap == 0


@kernel
def trace(node: int, rules: MoveRules, memory: SearchMemory, legs: FloatArray) -> int:
    """Write the way to an end that was found.

    Args:
        node: The end.
        rules: Of the search.
        memory: As the search left it.
        legs: Filled with duration [steps], length [m] and curvature [1/m] of each leg, shape (k, 3), long enough for
            one leg per step and `MOST_SEGMENTS`.

    Returns:
        Number of legs.
    """
    end, before = memory.link[node, 3], memory.link[node, 1]
    n_moves: int = memory.link[node, 0]
    for k in range(n_moves - 1, -1, -1):
        move = memory.link[before, 2]
        legs[k, 0], legs[k, 1], legs[k, 2] = 1.0, rules.length[move], rules.curvature[move]
        before = memory.link[before, 1]
    n = n_moves
    for k in range(memory.end_length[end]):
        length = memory.end[end, k, 0] * rules.radius
        if abs(length) > 1e-12:
            legs[n, 0], legs[n, 1], legs[n, 2] = abs(length) / rules.step, length, memory.end[end, k, 1] / rules.radius
            n += 1
    return n


@kernel
def sample(
    start: FloatArray, legs: FloatArray, n_legs: int, checks: int, pose: npt.NDArray[np.float64], car: int
) -> int:
    """Write the poses of a way at equal times into a timetable; returns how many.

    Args:
        start: Pose x, y, yaw, shape (3,).
        legs: Duration [steps], length [m] and curvature [1/m], shape (k, 3).
        n_legs: Legs of the way.
        checks: Samples of a step.
        pose: Of the timetable; the way has to fit in.
        car: Whose way it is.
    """
    x, y, yaw = start[0], start[1], start[2]
    pose[car, 0, 0], pose[car, 0, 1], pose[car, 0, 2], pose[car, 0, 3] = x, y, math.cos(yaw), math.sin(yaw)
    begin, k = 0.0, 1
    for leg in range(n_legs):
        duration, length, curvature = legs[leg, 0], legs[leg, 1], legs[leg, 2]
        while k <= (begin + duration) * checks + 1e-9:
            done = (k / checks - begin) / duration * length
            px, py, cos, sin, _ = _arc(x, y, yaw, done, curvature)
            pose[car, k, 0], pose[car, k, 1], pose[car, k, 2], pose[car, k, 3] = px, py, cos, sin
            k += 1
        x, y, _, _, yaw = _arc(x, y, yaw, length, curvature)
        begin += duration
    if k - 1 < begin * checks - 1e-9:
        pose[car, k, 0], pose[car, k, 1], pose[car, k, 2], pose[car, k, 3] = x, y, math.cos(yaw), math.sin(yaw)
        k += 1
    return k


@kernel
def _arc(x: float, y: float, yaw: float, length: float, curvature: float) -> tuple[float, float, float, float, float]:
    """Pose after an arc: x, y, cosine and sine of the yaw, yaw."""
    after = yaw + length * curvature
    cos, sin = math.cos(after), math.sin(after)
    if curvature == 0.0:
        return x + length * cos, y + length * sin, cos, sin, after
    return x + (sin - math.sin(yaw)) / curvature, y + (math.cos(yaw) - cos) / curvature, cos, sin, after


@kernel
def _move_cost(
    query: SearchQuery,
    node: int,
    move: int,
    n_near: int,
    floor: StaticFloor,
    table: WayTable,
    body: CarBody,
    rules: MoveRules,
    memory: SearchMemory,
) -> float:
    """Cost of a move [steps], infinite if it cannot be made; its poses are left in `swept`."""
    x, y, yaw = memory.pose[node, 0], memory.pose[node, 1], memory.pose[node, 2]
    cos, sin, swept = math.cos(yaw), math.sin(yaw), memory.swept
    for k in range(rules.checks):
        dx, dy, dcos, dsin = (
            rules.move[move, k, 0],
            rules.move[move, k, 1],
            rules.move[move, k, 2],
            rules.move[move, k, 3],
        )
        swept[k, 0], swept[k, 1] = x + cos * dx - sin * dy, y + sin * dx + cos * dy
        swept[k, 2], swept[k, 3] = cos * dcos - sin * dsin, sin * dcos + cos * dsin
    if move != _STAND:
        for k in range(rules.checks - 1, -1, -1):
            if not is_free(swept[k, 0], swept[k, 1], swept[k, 2], swept[k, 3], floor, body):
                return math.inf
    cost = 1.0
    if rules.curvature[move] != 0.0:
        cost += rules.turn_cost
    if rules.length[move] < 0.0:
        cost += rules.backwards_cost
    if rules.length[move] * rules.length[memory.link[node, 2]] < 0.0:
        cost += rules.cusp_cost
    begin = memory.link[node, 0] * rules.checks + 1
    for i in range(n_near):
        car = memory.near[i]
        for k in range(rules.checks):
            if touches(table, car, begin + k, swept[k, 0], swept[k, 1], swept[k, 2], swept[k, 3], body, rules.margin):
                cost += query.worth[car]
                break
        if cost == math.inf:
            return cost
    return cost


@kernel
def _end_cost(
    query: SearchQuery,
    node: int,
    row: int,
    distance: float,
    floor: StaticFloor,
    table: WayTable,
    body: CarBody,
    rules: MoveRules,
    memory: SearchMemory,
) -> float:
    """Cost of going straight to the goal from a node [steps], infinite if that is not possible.

    The segments are left in a row of `end`.
    """
    x, y, yaw, step = memory.pose[node, 0], memory.pose[node, 1], memory.pose[node, 2], memory.link[node, 0]
    cos, sin = math.cos(yaw), math.sin(yaw)
    dx, dy = query.goal[0] - x, query.goal[1] - y
    segments = memory.segments
    n = shortest_way(
        (dx * cos + dy * sin) / rules.radius,
        (dy * cos - dx * sin) / rules.radius,
        wrapped(query.goal[2] - yaw),
        segments,
    )
    length = 0.0
    for k in range(n):
        length += abs(segments[k, 0]) * rules.radius
        memory.end[row, k, 0], memory.end[row, k, 1] = segments[k, 0], segments[k, 1]
    memory.end_length[row] = n
    if length > _DETOUR * distance + _DETOUR_RADII * rules.radius:
        return math.inf
    cost = _swept_cost(query, x, y, yaw, step, n, floor, table, body, rules, memory)
    if cost == math.inf:
        return cost
    arrival = step * rules.checks + math.ceil(length / rules.step * rules.checks)
    for car in range(len(query.visit)):
        if query.visit[car] != NEVER and query.visit[car] >= arrival:
            cost += query.worth[car]
    before = rules.length[memory.link[node, 2]]
    for k in range(n):
        part = abs(segments[k, 0]) * rules.radius / rules.step
        if part < 1e-9:
            continue
        cost += part
        if segments[k, 1] != 0.0:
            cost += part * rules.turn_cost
        if segments[k, 0] < 0.0:
            cost += part * rules.backwards_cost
        if segments[k, 0] * before < 0.0:
            cost += rules.cusp_cost
        before = segments[k, 0]
    return cost


@kernel
def _swept_cost(
    query: SearchQuery,
    x: float,
    y: float,
    yaw: float,
    step: int,
    n: int,
    floor: StaticFloor,
    table: WayTable,
    body: CarBody,
    rules: MoveRules,
    memory: SearchMemory,
) -> float:
    """What others cost on the segments of an end [steps], infinite if obstacles or walls are in the way."""
    cost: float = 0.0
    k, begin, n_near = 1, 0.0, 0
    radius = table.reach + 2.0 * abs(body.centre)
    at_x, at_y = x, y
    for segment in range(n):
        length, curvature = memory.segments[segment, 0] * rules.radius, memory.segments[segment, 1] / rules.radius
        duration = abs(length) / rules.step
        last = segment == n - 1
        while k <= (begin + duration) * rules.checks + 1e-9 or (last and k < (begin + duration) * rules.checks + 1.0):
            share = min((k / rules.checks - begin) / duration, 1.0) if duration > 0.0 else 1.0
            at_x, at_y, cos, sin, _ = _arc(x, y, yaw, share * length, curvature)
            if not is_free(at_x, at_y, cos, sin, floor, body):
                return math.inf
            if (k - 1) % rules.checks == 0:
                n_near = cars_near(table, at_x, at_y, step + (k - 1) // rules.checks, radius, memory.near)
            i = 0
            while i < n_near:
                car = memory.near[i]
                if touches(table, car, step * rules.checks + k, at_x, at_y, cos, sin, body, rules.margin):
                    cost += query.worth[car]
                    if cost == math.inf:
                        return cost
                    n_near -= 1  # it is counted once in a step
                    memory.near[i] = memory.near[n_near]
                else:
                    i += 1
            k += 1
        x, y, _, _, yaw = _arc(x, y, yaw, length, curvature)
        begin += duration
    return cost


@kernel
def _left(query: SearchQuery, x: float, y: float, yaw: float, floor: StaticFloor, rules: MoveRules) -> float:
    """What is expected to be left to the goal [steps]."""
    dx, dy = query.goal[0] - x, query.goal[1] - y
    distance = math.hypot(dx, dy)
    across, up = cell_of(x, y, floor)
    left: float = query.distance[across, up]
    if left == math.inf:
        left = distance
    if distance < TABLE_RADII * rules.radius:
        cos, sin = math.cos(yaw) / rules.radius, math.sin(yaw) / rules.radius
        curve = tabulated_length(query.curve, dx * cos + dy * sin, dy * cos - dx * sin, query.goal[2] - yaw)
        left = max(left, curve * rules.radius)
    return left / rules.step


@kernel
def _key(x: float, y: float, yaw: float, step: int, floor: StaticFloor, rules: MoveRules) -> int:
    """One number for poses that count as one."""
    across, up = int(x / rules.cell), int(y / rules.cell)
    heading = int(yaw % (2.0 * math.pi) / (2.0 * math.pi) * rules.headings + 0.5) % rules.headings
    n_across, n_up = int(floor.width / rules.cell) + 1, int(floor.height / rules.cell) + 1
    return ((step * n_across + across) * n_up + up) * rules.headings + heading


@kernel
def _note(seen: IntArray, key: int) -> bool:
    """Remember a key; whether it is new."""
    mask = len(seen) - 1
    at = (key * 0x9E3779B1 >> 7) & mask
    while seen[at] != -1:
        if seen[at] == key:
            return False
        at = (at + 1) & mask
    seen[at] = key
    return True


@kernel
def _push(heap: IntArray, n: int, cost: FloatArray, node: int) -> None:
    """Put a node into a heap of n, ordered by expected cost."""
    k = n
    while k > 0:
        parent = (k - 1) // 2
        if cost[heap[parent], 1] <= cost[node, 1]:
            break
        heap[k] = heap[parent]
        k = parent
    heap[k] = node


@kernel
def _pop(heap: IntArray, n: int, cost: FloatArray) -> int:
    """Take the least node out of a heap of n."""
    least: int = heap[0]
    node = heap[n - 1]
    k, n = 0, n - 1
    while True:
        child = 2 * k + 1
        if child >= n:
            break
        if child + 1 < n and cost[heap[child + 1], 1] < cost[heap[child], 1]:
            child += 1
        if cost[heap[child], 1] >= cost[node, 1]:
            break
        heap[k] = heap[child]
        k = child
    heap[k] = node
    return least
