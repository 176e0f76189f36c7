"""What agents of the dispatch layer are told, and which tasks they can choose; the same for every fidelity."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from fleet.abstract.compiled import allocating
from fleet.abstract.fleet import STATION_ROOM, TIMESTEP_S, FleetSite
from fleet.abstract.kernel import NONE, TO_DROP, UNLOADING, Bools, Floor, Ints, SmallInts
from fleet.arrays import FloatArray
from fleet.config import AllocationConfig
from planners.allocation.costs import CostWeights, task_costs
from planners.mapf.distance_table import UNREACHABLE

N_OWN, N_PER_CANDIDATE, N_SUMMARY = 12, 19, 5
"""Numbers about the car itself, about each candidate, and about the fleet."""
N_LINE, N_DROP_LINE = 5, 3
"""Of those of a candidate, numbers about what waits at its pick station and at its drop station."""
N_BATTERY = 2
"""Numbers about batteries, where cars have some."""
TIME_S = 300.0
"""Times are told in units of this [s]."""
SOON_S = 120.0
"""Tasks with less time to spare than this are counted [s]."""
MOST_CROWDED = 4
"""Nearer cars are counted up to this."""
_TIES = 1 << 20


class DispatchView(NamedTuple):
    """A fleet as dispatch sees it; n cars, m ready tasks, k stations.

    Flat on purpose: these are the arrays that policies read (`env.view.task`) and that one kernel is handed.
    """

    now_s: float
    left: float
    """Share of the episode that is left."""
    pose: FloatArray
    """Shape (n, 3)."""
    state: Ints
    """Lane-graph state in which each car's way ends as far as it is granted, shape (n,)."""
    goal: Ints
    """Lane-graph state, or `NONE`, shape (n,)."""
    phase: SmallInts
    """`Phase` of each car, shape (n,)."""
    held: Bools
    """Waits for room at its station, shape (n,)."""
    free: Bools
    """May be given a task, shape (n,)."""
    task: Ints
    """The ready tasks, ascending, shape (m,)."""
    order: Ints
    """The order that each is of; of those of one order only one can be had, shape (m,)."""
    pick: Ints
    drop: Ints
    """Their stations, shape (m,)."""
    rank: SmallInts
    """Their priority classes, 0 = most urgent, shape (m,)."""
    age_s: FloatArray
    due_s: FloatArray
    """Time since the release, and until the due date (inf = none), shape (m,)."""
    charge: FloatArray
    """What is in the battery of each car, 1 = full, shape (n,)."""
    chargers_left: float
    """Share of the chargers that nobody has; 0 where there are none."""
    under_way: Ints
    """Tasks whose cars have still to come to each station, shape (k,)."""

    def only(self, columns: npt.NDArray[np.int64]) -> DispatchView:
        """The same fleet with some of the ready tasks, ascending indices into `task`."""
        tasks = {
            name: getattr(self, name)[columns] for name in ("task", "order", "pick", "drop", "rank", "age_s", "due_s")
        }
        return self._replace(**tasks)


class DispatchObserver:
    """Makes rows of numbers in [-1, 1] of a fleet (layout: see `fleet.envs.dispatch.env`).

    Args:
        place: The site.
        n_candidates: Tasks that a car can choose from.
        batteries: Whether cars are told of batteries and chargers.
    """

    def __init__(self, place: FleetSite, n_candidates: int, *, batteries: bool = False) -> None:
        self._place = place
        self._k = n_candidates
        self._batteries = batteries
        self.n_numbers = N_OWN + n_candidates * N_PER_CANDIDATE + N_SUMMARY + N_BATTERY * batteries
        """Length of a row."""
        self._service_s = 2 * place.floor.service_steps * TIMESTEP_S
        self._size = np.array([place.site.grid.cols, place.site.grid.rows]) * place.site.grid.cell_m

    def look(self, view: DispatchView) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.int8], Ints]:
        """Observe all cars.

        Returns:
            Observations, shape (n, n_numbers); which of the k + 1 actions are legal, shape (n, k + 1); the task that
            each candidate of each car is, `NONE` for none, shape (n, k).
        """
        n, k = len(view.state), self._k
        rows = np.zeros((n, self.n_numbers), dtype=np.float32)
        mask = np.zeros((n, k + 1), dtype=np.int8)
        candidates = np.full((n, k), NONE, dtype=np.int32)
        mask[:, 0] = 1
        self._tell_own(view, rows)
        # In four of ten steps nobody can choose, and what waits need not be looked through.
        if len(view.task) and view.free.any():
            fill_candidates(
                self._place.floor,
                view,
                np.lexsort((view.task, view.due_s, view.rank)),
                self._place.far_steps,
                rows,
                mask,
                candidates,
            )
        rows[:, 11] = mask[:, 1]
        at = N_OWN + k * N_PER_CANDIDATE
        rows[:, at : at + N_SUMMARY] = self._summary(view)
        if self._batteries:
            rows[:, at + N_SUMMARY] = view.charge
            rows[:, at + N_SUMMARY + 1] = view.chargers_left
        np.clip(rows, -1.0, 1.0, out=rows)
        return rows, mask, candidates

    def cost_s(self, view: DispatchView, config: AllocationConfig | None = None) -> FloatArray:
        """What each ready task costs each car as seconds of travel, shape (n, m); inf = not to be had.

        The price of `fleet.dispatch.cost_model`, from the same facts, but for what agents are not told: how long a car
        would wait for its turns at both arms.

        Args:
            view: The fleet.
            config: What lateness, due dates and ageing are worth; None = the defaults of a run.
        """
        config = config if config is not None else AllocationConfig()
        return task_costs(
            travel_s=self._travel_s(view),
            rest_s=self._rest_s(view),
            service_s=np.full(len(view.task), self._service_s),
            since_s=-view.age_s,
            due_s=view.due_s,
            now_s=0.0,  # the view tells times from now
            weights=CostWeights(lateness=config.lateness, ageing=config.ageing, due=config.due),
        ).cost_s

    def takes_s(self, view: DispatchView) -> FloatArray:
        """Time until each car would have done each ready task, if nobody was in its way, shape (n, m); inf as above."""
        return self._travel_s(view) + self._rest_s(view) + self._service_s

    def _travel_s(self, view: DispatchView) -> FloatArray:
        """Time of each car to where each ready task begins, shape (n, m) [s]; inf = not to be had."""
        floor = self._place.floor
        moves = floor.distance[floor.dock_row[view.pick], view.state[:, None]].astype(np.float64)
        moves[moves >= UNREACHABLE] = np.inf
        moves[~view.free] = np.inf
        moves[:, ~self.offered(view)] = np.inf
        return moves * TIMESTEP_S

    def _rest_s(self, view: DispatchView) -> FloatArray:
        """Time from there to where each ends, shape (m,) [s]."""
        floor = self._place.floor
        rest = floor.distance[floor.dock_row[view.drop], floor.dock_state[view.pick]].astype(np.float64)
        return rest * TIMESTEP_S

    @staticmethod
    def offered(view: DispatchView) -> Bools:
        """Whether there is room for one more task at both ends of each ready task, shape (m,)."""
        offered: Bools = np.maximum(view.under_way[view.pick], view.under_way[view.drop]) < STATION_ROOM
        return offered

    def _tell_own(self, view: DispatchView, rows: npt.NDArray[np.float32]) -> None:
        floor = self._place.floor
        rows[:, 0:2] = 2.0 * view.pose[:, :2] / self._size - 1.0
        rows[:, 2], rows[:, 3] = np.cos(view.pose[:, 2]), np.sin(view.pose[:, 2])
        rows[:, 4:9] = view.phase[:, None] == np.arange(5)
        rows[:, 9] = view.held
        goal_row = self._place.goal_row
        known = np.flatnonzero((view.goal >= 0) & (goal_row[view.goal] >= 0))
        rows[known, 10] = floor.distance[goal_row[view.goal[known]], view.state[known]] / self._place.far_steps

    def _summary(self, view: DispatchView) -> FloatArray:
        n = len(view.state)
        loaded = np.isin(view.phase, (TO_DROP, UNLOADING))
        late = view.due_s < 0.0
        return np.array(
            [
                view.free.mean(),
                len(view.task) / (len(view.task) + n),
                loaded.mean(),
                late.mean() if len(late) else 0.0,
                view.left,
            ]
        )


@allocating
def lines(
    view: DispatchView, pressing: npt.NDArray[np.int64], n_stations: int, service_s: float
) -> FloatArray:  # pragma: no cover - compiled
    """Describe what waits at each station: the tasks that nobody has and that begin or end there.

    Args:
        view: The fleet.
        pressing: Its ready tasks, the most pressing first, shape (m,).
        n_stations: Number of stations, k.
        service_s: Time that an arm needs for a car [s].

    Returns:
        Numbers in [-1, 1], shape (k, `N_LINE`), of r as r / (r + cars): how many tasks wait; the least time to spare of
        any of them if the arm, from now on, did nothing but serve the cars that are under way to it and then these
        tasks, the most pressing first (1 = plenty); how many are late; how many have less than `SOON_S` to spare; and
        the place of the first late one in the line.
    """
    n_cars = len(view.state)
    counts = np.zeros((n_stations, N_LINE))
    spare_s = np.full(n_stations, np.inf)
    for j in pressing:
        for station in (view.pick[j], view.drop[j]):
            counts[station, 0] += 1
            own_s = view.due_s[j] - (view.under_way[station] + counts[station, 0]) * service_s
            spare_s[station] = min(spare_s[station], own_s)
            counts[station, 3] += own_s < SOON_S
            if view.due_s[j] < 0.0:
                counts[station, 2] += 1
                if counts[station, 4] == 0:
                    counts[station, 4] = counts[station, 0]
    told = counts / (counts + n_cars)
    told[:, 1] = np.minimum(1.0, np.maximum(-1.0, spare_s / TIME_S))
    return told


@allocating
def least_ways(
    floor: Floor, states: Ints, n_in_line: npt.NDArray[np.int64]
) -> npt.NDArray[np.int64]:  # pragma: no cover - compiled
    """Find how near the nearest free cars are to each station at which tasks are on offer.

    Args:
        floor: The site.
        states: Of the free cars, shape (f,).
        n_in_line: Tasks on offer at each station, shape (k,).

    Returns:
        The least distances, ascending, in timesteps, shape (k, `MOST_CROWDED`).
    """
    near = np.full((len(n_in_line), MOST_CROWDED), np.int64(UNREACHABLE))
    for station in range(len(n_in_line)):
        if n_in_line[station] > 0:
            own, moves = near[station], floor.distance[floor.dock_row[station]]
            for state in states:
                if moves[state] < own[-1]:
                    own[-1] = moves[state]
                    own.sort()
    return near


@allocating
def fill_candidates(
    floor: Floor,
    view: DispatchView,
    pressing: npt.NDArray[np.int64],
    far_steps: float,
    rows: npt.NDArray[np.float32],
    mask: npt.NDArray[np.int8],
    candidates: Ints,
) -> None:  # pragma: no cover - compiled
    """Find the candidates of every free car and describe them.

    Of each pick station its most pressing task is a candidate, then of each its second most pressing one, and so on,
    nearer stations first, until all `k` places are taken. They are listed by their distance, the nearest first; of
    equally near ones the most pressing first.

    Args:
        floor: The site.
        view: The fleet.
        pressing: Its ready tasks, the most pressing first, shape (m,).
        far_steps: Unit of distances, in timesteps.
        rows: Receives the descriptions, shape (n, n_numbers).
        mask: Receives the legal actions, shape (n, k + 1).
        candidates: Receives the tasks, shape (n, k).
    """
    k, n_stations = candidates.shape[1], len(floor.dock_row)
    # The first k tasks on offer at each station, as places in `pressing`: no car has more candidates.
    line = np.empty((n_stations, k), dtype=np.int64)
    n_in_line = np.zeros(n_stations, dtype=np.int64)
    for a in range(len(pressing)):
        pick = view.pick[pressing[a]]
        if n_in_line[pick] < k and max(view.under_way[pick], view.under_way[view.drop[pressing[a]]]) < STATION_ROOM:
            line[pick, n_in_line[pick]] = a
            n_in_line[pick] += 1
    waiting = lines(view, pressing, n_stations, floor.service_steps * TIMESTEP_S)
    free_cars = np.flatnonzero(view.free)
    near = least_ways(floor, view.state[free_cars], n_in_line)
    keys = np.empty(n_stations, dtype=np.int64)
    chosen = np.empty(k, dtype=np.int64)
    for car in free_cars:
        found, turn = 0, 0
        while found < k:
            n = 0
            for station in range(n_stations):
                if turn < n_in_line[station]:
                    moves = np.int64(floor.distance[floor.dock_row[station], view.state[car]])
                    if moves < UNREACHABLE:
                        keys[n] = moves * _TIES + line[station, turn]
                        n += 1
            if n == 0:
                break
            keys[:n].sort()
            n = min(n, k - found)
            chosen[found : found + n] = keys[:n]
            found += n
            turn += 1
        chosen[:found].sort()
        for c in range(found):
            moves, j = chosen[c] // _TIES, pressing[chosen[c] % _TIES]
            candidates[car, c] = view.task[j]
            mask[car, c + 1] = 1
            rest = floor.distance[floor.dock_row[view.drop[j]], floor.dock_state[view.pick[j]]]
            nearer = np.searchsorted(near[view.pick[j]], moves)
            at = N_OWN + c * N_PER_CANDIDATE
            rows[car, at] = 1.0
            rows[car, at + 1] = moves / far_steps
            rows[car, at + 2] = rest / far_steps
            rows[car, at + 3] = view.age_s[j] / TIME_S
            if math.isfinite(view.due_s[j]):
                takes_s = (moves + rest + 2 * floor.service_steps) * TIMESTEP_S
                rows[car, at + 4] = 1.0
                rows[car, at + 5] = (view.due_s[j] - takes_s) / TIME_S
            rows[car, at + 6] = view.rank[j] == 0
            rows[car, at + 7] = view.rank[j] == 2
            rows[car, at + 8] = view.under_way[view.pick[j]] / STATION_ROOM
            rows[car, at + 9] = view.under_way[view.drop[j]] / STATION_ROOM
            rows[car, at + 10] = nearer / MOST_CROWDED
            at += 11
            for number in range(N_LINE):
                rows[car, at + number] = waiting[view.pick[j], number]
            at += N_LINE
            for number in range(N_DROP_LINE):
                rows[car, at + number] = waiting[view.drop[j], number]
