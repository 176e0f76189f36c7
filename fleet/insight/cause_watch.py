"""CauseWatch: finds out in every tick what each robot is about, and whom it waits for."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np
from numba import njit

from fleet.arrays import BoolArray, CellArray, FloatArray, IntArray
from fleet.insight.cause_log import CauseLog
from fleet.insight.causes import DETAIL_OF, NONE, Cause, CauseRows, Column
from fleet.insight.time_accounts import STANDING_MPS
from fleet.insight.why_idle import WhyIdle
from fleet.missions.phases import NUMBER_OF_PHASE, PHASES, CarPhase
from fleet.run.view import RunView
from fleet.stations.arms.arm_controller import ArmPhase
from planners.precedence.queues import NOBODY, Queues, move_at

_BOUND, _IDLE, _REST = 0, 1, 2
_UNDER_WAY = (CarPhase.TO_PICK, CarPhase.TO_DROP, CarPhase.TO_CHARGER, CarPhase.TO_PLACE, CarPhase.HELD)
_RULES = np.array(
    [_BOUND if phase in _UNDER_WAY else _IDLE if phase is CarPhase.IDLE else _REST for phase in PHASES],
    dtype=np.int64,
)
"""Cars on their way change from tick to tick, also those that are held back, or have no task, and drive to a parking
place; the others only when something is decided."""
_HELD_PHASE, _IDLE_PHASE = NUMBER_OF_PHASE[CarPhase.HELD], NUMBER_OF_PHASE[CarPhase.IDLE]
_RESTS = np.array(
    [
        phase not in (CarPhase.IDLE, CarPhase.TO_PICK, CarPhase.TO_DROP, CarPhase.TO_CHARGER, CarPhase.TO_PLACE)
        for phase in PHASES
    ]
)
"""Phases of cars that stand where they are, for a reason that is looked up."""
# Kernels know plain numbers only.
_DRIVES, _SETS_OFF, _CELL, _TURN = int(Cause.DRIVES), int(Cause.SETS_OFF), int(Cause.CELL), int(Cause.TURN)
_CLOSED, _BLOCKED, _HALTED = int(Cause.CLOSED), int(Cause.BLOCKED), int(Cause.HALTED)
_YIELDS, _PLAN_LATE = int(Cause.YIELDS), int(Cause.PLAN_LATE)
_AWAITS, _NO_TASK = int(Cause.AWAITS), int(Cause.NO_TASK)
_CAUSE, _BY, _AT, _PLACE, _UNTIL, _TASK, _DETAIL = map(int, Column)
_AT_DOCK = (CarPhase.LOADING, CarPhase.UNLOADING)
_FREE = (ArmPhase.IDLE, ArmPhase.HOLDING)
KEPT, KEPT_OF_EACH = 2**16, 512
"""So many of the last changes are kept, of all robots and for each: hours of a small fleet, minutes of a large one in
dense traffic. The file of a run has all of them."""
_LOOK_UP = -2  # on its way without a move


class _Cars(NamedTuple):
    """What is known of the cars, shape (n_cars,)."""

    phase: IntArray
    """Index into `PHASES`."""
    paces: FloatArray
    place_of: IntArray
    without_task: CauseRows
    halted_by: CellArray
    parked: BoolArray


class _Cells(NamedTuple):
    """What is known of the cells, shape (n_cells,)."""

    closed: BoolArray
    blocked: BoolArray
    wreck_of: CellArray
    dock_at: CellArray
    """The arm over each dock, -1 elsewhere."""


class CauseWatch:
    """The causes of all robots, tick by tick.

    It only looks: nothing in the run depends on it. What changes from tick to tick is found by a kernel, the rest is
    looked up when phases, bookings, or the tasks given out have changed.

    Args:
        run: The run that is watched.
        halted_by: Tells which cars stand because their granted way leads through another one, and that one.
    """

    def __init__(self, run: RunView, halted_by: Callable[[], Mapping[int, int]]) -> None:
        self._run = run
        self._halted = halted_by
        self._n_cars = run.world.n_cars
        self._tray_of = run.scene.cars.tray_of
        n_robots = self._n_cars + run.world.n_arms
        self.rows: CauseRows = np.full((n_robots, len(Column)), NONE, dtype=np.int32)
        """The present tick."""
        self.rows[:, Column.CAUSE] = Cause.NO_TASK
        self.rows[:, Column.DETAIL] = 0
        self.log = CauseLog(n_robots, max(KEPT, KEPT_OF_EACH * n_robots))
        graph = run.graph
        self._dock_at = np.full(graph.n_cells, NONE, dtype=np.int32)
        for station in run.stations:
            self._dock_at[graph.state_cell[station.dock_state]] = station.arm
        self._why_idle = WhyIdle(run)
        self._given, self._booked, self._phases = (-1, -1), -1, -1
        self._tables: object = None
        self._seen = np.full(self._n_cars, NONE, dtype=np.int64)
        self._gated = any(service.gate is not None for service in run.arm_manager.services)
        self._arm_changes = np.full(run.world.n_arms, NONE, dtype=np.int64)
        self._arm_waits = self._arm_changes.copy()
        self._n_arm_bookings = -1
        self._arm_served = np.full(run.world.n_arms, NONE, dtype=np.int64)
        """The car that each arm served when its row was filled, shape (n_arms,)."""
        self._arm_until = np.full(run.world.n_arms, NONE, dtype=np.int64)
        self._clear_tick = [NONE] * run.world.n_arms
        self._halted_by = np.full(self._n_cars, NONE, dtype=np.int32)
        self._parked = np.zeros(self._n_cars, dtype=np.bool_)
        """Cars that are held back, or have no task, and have come to the parking place where they wait."""
        self._without_task = self.rows[: self._n_cars].copy()
        """Why cars without a task have none: their rows when nothing keeps them on their way."""

    def tick(self, tick: int, paces: FloatArray) -> None:
        """Look at the tick that was just done.

        Args:
            tick: Its number.
            paces: How fast the cars move along their paths, by turns on the spot, too [m/s], shape (n_cars,).
        """
        run = self._run
        self._look_at_arms(tick)
        self._look_at_rest(tick)
        self._halted_by[:] = NONE
        for car, by in self._halted().items():
            self._halted_by[car] = by
        executor, traffic = run.executor, run.traffic
        roster = run.missions
        cars = _Cars(
            roster.phase_index, paces, run.bookings.place_of, self._without_task, self._halted_by, self._parked
        )
        cells = _Cells(executor.closed, traffic.blocked, traffic.wreck_of, self._dock_at)
        without_move = _look_at_bound(self.rows, _RULES, executor.dependencies.queues, cars, cells)
        if without_move:
            self._look_at_without_move(tick)
        _leave_out_free_arms(self.rows, self._n_cars)
        for car in executor.driver.hindrances.held:
            self._set(car, Cause.FAULT, detail=DETAIL_OF["stopped"])
        self.log.append(tick, self.rows)

    def _look_at_without_move(self, tick: int) -> None:
        """Cars on their way that stand and have no move left: they are there, or nothing is planned for them."""
        run = self._run
        traffic, tails = run.traffic, run.executor.tail_states()
        goals = traffic.goals
        held, at_goal, away = _sort_out(
            self.rows, tails, goals, run.missions.phase_index, self._without_task, self._parked
        )
        for car in held.tolist():
            self._set_held(car)
        for car in at_goal.tolist():
            self._look_at_goal(car, int(self.rows[car, _PLACE]))
        if not len(away):
            return
        cells = traffic.next_cells(tails[away], goals[away])
        for car in away[cells < 0].tolist():
            cell = traffic.obstacle(int(tails[car]), int(goals[car]))
            self._set(car, Cause.BLOCKED, by=self._wreck(cell), cell=cell, place=int(self.rows[car, _PLACE]))
        self._set_next_cells(away, cells, tick)

    def _wreck(self, cell: int) -> int:
        """The dead car that blocks a cell."""
        return int(self._run.traffic.wreck_of[cell]) if cell >= 0 else NONE

    def _set_next_cells(self, cars: CellArray, cells: CellArray, tick: int) -> None:
        """Cars that a plan has left standing before a cell: somebody has it, or comes first, or the plan is late.

        Args:
            cars: The cars, shape (k,).
            cells: The next cell of each, below 0 = it has none, shape (k,).
            tick: The present tick.
        """
        traffic, q = self._run.traffic, self._run.executor.dependencies.queues
        landed, goals = traffic.landed_goals, traffic.goals
        late = _look_at_next_cells(self.rows, cars, cells, q.holder, q.line_first, q.visit_agent, landed, goals)
        for car in late.tolist():
            self.rows[car, _UNTIL] = traffic.next_plan_tick(car, tick)

    def _look_at_goal(self, car: int, place: int) -> None:
        """A car that has come to where it was sent."""
        run = self._run
        phase, task = run.missions.phase[car], run.missions.task_of[car]
        cause, by, until = Cause.SETS_OFF, NONE, NONE
        if phase in (CarPhase.TO_PICK, CarPhase.TO_DROP) and task is not None and run.executor.idle(car):
            station = run.stations[place]
            if not run.arm_manager.is_ready(station.arm, task.parcel, int(self._tray_of[car])):
                cause, by = Cause.ARM, self._n_cars + station.arm
            elif phase is CarPhase.TO_DROP and task.drop_slot is None and station.n_free == 0:
                cause, leaves_s = Cause.SLOT, station.next_collect_s
                until = NONE if leaves_s is None else round(leaves_s / run.tick_s)
        self._set(car, cause, by=by, place=place, until=until)

    def _look_at_rest(self, tick: int) -> None:
        """Cars that are not on their way; each only if something was decided that may concern it."""
        run = self._run
        roster = run.missions
        given = (run.assignments.n_allocations, run.board.n_moves)
        booked, phases = run.bookings.n_changes, roster.n_changes
        tables = run.traffic.tables
        if (given, booked, phases) == (self._given, self._booked, self._phases) and tables is self._tables:
            return
        phases_now, n_cars = roster.phase_index, self._n_cars
        begun = phases_now != self._seen
        self._parked[begun] = False
        held = phases_now == _HELD_PHASE
        concerned = begun | held if given[0] == self._given[0] else np.ones(n_cars, dtype=np.bool_)
        with_task = concerned & (phases_now != _IDLE_PHASE)
        self.rows[:n_cars, _TASK][with_task] = roster.task_index[with_task]
        # Of those that are held only who has come to a parking place is at rest; those under way change in every tick.
        for car in (concerned & _RESTS[phases_now] & (~held | self._parked)).nonzero()[0].tolist():
            self._set_at_rest(car, roster.phase[car], tick)
        self._seen = phases_now.copy()
        idle = (phases_now == _IDLE_PHASE).nonzero()[0]
        if len(idle) and (given != self._given or phases != self._phases or tables is not self._tables):
            self._why_idle.fill(self._without_task, idle)
        self._given, self._booked, self._phases, self._tables = given, booked, phases, tables

    def _set_at_rest(self, car: int, phase: CarPhase, tick: int) -> None:
        """A car that is not on its way, and not idle."""
        run = self._run
        roster = run.missions
        if phase is CarPhase.HELD:
            self._set_held(car)
        elif phase in _AT_DOCK:
            self._set_served(car, roster.served.tolist().index(car))
        elif phase is CarPhase.CHARGING:
            place = int(run.bookings.place_of[car])
            self._set(car, Cause.CHARGES, place=place, until=self._charged_tick(car, tick))
        elif phase is CarPhase.STANDING:
            leaves_s, place = run.visits.leave_s(car), int(run.bookings.place_of[car])
            until = NONE if leaves_s is None else round(leaves_s / run.tick_s)
            self._set(car, Cause.VISITS, place=place, until=until, detail=DETAIL_OF[run.visits.handles(car)])
        elif phase in (CarPhase.RECOVERING, CarPhase.RETIRED, CarPhase.DEAD):
            arm = self._dock_at[run.graph.state_cell[run.executor.tail_states()[car]]]
            if phase is CarPhase.DEAD and arm != NONE and run.arm_manager.dead[arm]:
                self._set(car, Cause.FAULT, by=self._n_cars + int(arm), detail=DETAIL_OF["below_arm"])
            else:
                self._set(car, Cause.FAULT, detail=self._fault(car, phase))

    def _fault(self, car: int, phase: CarPhase) -> int:
        if phase is CarPhase.RETIRED and car in self._run.missions.leaving:
            return DETAIL_OF["out"]
        if phase is CarPhase.RETIRED:
            return DETAIL_OF["pod_loaded" if self._run.visits.keeps_pod(car) else "tray_loaded"]
        if phase is CarPhase.RECOVERING:
            return DETAIL_OF["off_lane"]
        batteries = self._run.batteries
        empty = batteries is not None and batteries.charge[car] <= 0.0
        return DETAIL_OF["battery_empty" if empty else "dead"]

    def _set_held(self, car: int) -> None:
        """A car that waits in a parking place for room, or for its time."""
        run = self._run
        bookings, served = run.bookings, run.missions.served
        place = int(bookings.place_of[car])
        if place < 0:
            self._set(car, Cause.SETS_OFF)
            return
        there = [other for other in bookings.cars(place) if other != car]
        if not bookings.has(car) and bookings.room(place) <= 0 and there:
            first = int(served[place]) if place < len(served) and int(served[place]) in there else there[0]
            self._set(car, Cause.STATION_FULL, by=first, place=place)
        elif place < len(served):
            self._set(car, Cause.ARM_BUSY, by=self._n_cars + place, place=place)
        else:
            # A parking place or charger has no arm to wait for: there is room, and the car is about to be called.
            self._set(car, Cause.SETS_OFF, place=place)

    def _charged_tick(self, car: int, tick: int) -> int:
        """When a charging car will have enough, or be full; kept until then, because charging is linear."""
        row, batteries = self.rows[car], self._run.batteries
        if row[Column.CAUSE] == Cause.CHARGES and row[Column.UNTIL] > tick:
            return int(row[Column.UNTIL])
        if batteries is None:
            return NONE
        charge, config = float(batteries.charge[car]), batteries.config
        target = config.enough if charge < config.enough else config.full
        return tick + max(0, round(batteries.charge_s(target - charge) / self._run.tick_s))

    def _look_at_arms(self, tick: int) -> None:
        """Arms, when what one does or who is bound for it changes, or it takes longer than was said."""
        run, n_changes = self._run, self._run.arm_manager.n_changes
        services, n_bookings = run.arm_manager.services, run.bookings.n_changes
        anew = (n_changes != self._arm_changes) | ((self._arm_until != NONE) & (self._arm_until <= tick))
        self._arm_changes[:] = n_changes
        if self._gated:
            waits = np.array([service.waits_for for service in services])
            anew |= waits != self._arm_waits
            self._arm_waits = waits
        if n_bookings != self._n_arm_bookings:
            # Who is bound for an arm is told of one that is free; one that serves a car is looked at in any case.
            served, changed_at = run.missions.served, run.bookings.changed_at[: len(services)]
            differ = (served >= 0) | (served != self._arm_served) | (changed_at > self._n_arm_bookings)
            for arm in (differ & ~anew).nonzero()[0].tolist():
                anew[arm] = services[arm].state in _FREE
            self._n_arm_bookings = n_bookings
        for arm in anew.nonzero()[0].tolist():
            self._set_arm(arm, tick)

    def _set_arm(self, arm: int, tick: int) -> None:
        run = self._run
        service = run.arm_manager.services[arm]
        served = int(run.missions.served[arm])
        slow = DETAIL_OF["slow"] if service.speed < 1.0 else 0
        robot = self._n_cars + arm
        task = run.missions.task_of[served] if served >= 0 else None
        self.rows[robot, _TASK] = NONE if task is None else task.index
        self._arm_served[arm] = served
        clear = until = NONE
        if run.arm_manager.is_stopped(arm):
            detail = DETAIL_OF["dead" if run.arm_manager.dead[arm] else "stopped"]
            self._set(robot, Cause.FAULT, place=arm, detail=detail)
        elif service.state in _FREE and served >= 0 and run.missions.phase[served] in _AT_DOCK:
            # Between two attempts: it is about to say that the parcel is there, or to plan again.
            self._set(robot, Cause.WORKS, place=arm, detail=slow)
        elif service.state in _FREE:
            bound = [car for car in run.bookings.bound(arm) if car != served]
            booked = [car for car in bound if run.bookings.has(car)]
            if bound:
                self._set(robot, Cause.AWAITS, by=(booked or bound)[0], place=arm)
            else:
                self._set(robot, Cause.NO_TASK, place=arm)
        elif service.state is ArmPhase.PLANNING:
            due = run.arm_manager.due_tick(arm)
            until = NONE if due is None else due
            self._set(robot, Cause.PLAN_LATE, place=arm, until=until, detail=slow)
        elif service.waits_for >= 0:
            self._set(robot, Cause.OTHER_ARM, by=self._n_cars + service.waits_for, place=arm)
        else:
            clear_s, left_s = service.left_s()
            clear, until = tick + round(clear_s / run.tick_s), tick + round(left_s / run.tick_s)
            self._set(robot, Cause.WORKS, place=arm, until=until, detail=slow)
        self._clear_tick[arm], self._arm_until[arm] = clear, until
        if served >= 0 and run.missions.phase[served] in _AT_DOCK:
            self._set_served(served, arm)

    def _set_served(self, car: int, arm: int) -> None:
        """A car at a dock whose arm is at work on it, or has to stand still over it."""
        if self._run.arm_manager.is_stopped(arm):
            self._set(car, Cause.ARM, by=self._n_cars + arm, place=arm)
        else:
            self._set(car, Cause.SERVED, by=self._n_cars + arm, place=arm, until=self._clear_tick[arm])

    def _set(
        self,
        robot: int,
        cause: Cause,
        *,
        by: int = NONE,
        cell: int = NONE,
        place: int = NONE,
        until: int = NONE,
        detail: int = 0,
    ) -> None:
        """Fill a robot's row, but for its task."""
        self.rows[robot] = (cause, by, cell, place, until, self.rows[robot, _TASK], detail)


@njit(cache=True)
def _look_at_bound(rows: CauseRows, rules: IntArray, q: Queues, cars: _Cars, cells: _Cells) -> int:
    """Fill the rows of cars on their way; returns how many of them stand without a move."""
    phase, paces, place_of, without_task, halted_by, parked = cars
    closed, blocked, wreck_of, dock_at = cells
    n_cars = len(phase)
    without_move = 0
    for car in range(n_cars):
        rule = rules[phase[car]]
        if rule == _REST:
            continue
        if rule == _IDLE:
            for column in range(rows.shape[1]):
                rows[car, column] = without_task[car, column]
        if parked[car]:
            if q.queued[car] == q.finished[car]:
                continue
            parked[car] = False
        by = cell = NONE
        cause = _SETS_OFF
        if abs(paces[car]) >= STANDING_MPS:
            cause = _DRIVES
        elif halted_by[car] >= 0:
            cause, by = _HALTED, halted_by[car]
        elif q.granted[car] > q.finished[car]:
            pass  # it is about to move
        elif q.queued[car] > q.granted[car]:
            move = move_at(q, car, q.granted[car])
            for k in range(q.swept_ptr[move], q.swept_ptr[move + 1]):
                swept = q.swept_cell[k]
                if q.holder[swept] != NOBODY and q.holder[swept] != car:
                    cause, by, cell = _CELL, q.holder[swept], swept
                    break
                first = q.visit_agent[q.line_first[swept]]
                if first != car and cell == NONE:
                    cause, by, cell = _TURN, first, swept
            target = q.state_cell[q.move_to[move]]
            if cell == NONE and closed[target]:
                cell = target
                if blocked[target]:
                    cause, by = _BLOCKED, wreck_of[target]
                else:
                    cause, by = _CLOSED, n_cars + dock_at[target] if dock_at[target] >= 0 else NONE
        else:
            cause = _LOOK_UP
            without_move += 1
        if rule == _IDLE:
            if cause in (_DRIVES, _SETS_OFF):
                continue
            rows[car, _TASK] = NONE
        rows[car, _CAUSE] = cause
        rows[car, _BY] = by
        rows[car, _AT] = cell
        rows[car, _PLACE] = place_of[car]
        rows[car, _UNTIL] = NONE
        rows[car, _DETAIL] = 0
    return without_move


@njit(cache=True)
def _sort_out(
    rows: CauseRows,
    tails: CellArray,
    goals: CellArray,
    phase: IntArray,
    without_task: CauseRows,
    parked: BoolArray,
) -> tuple[CellArray, CellArray, CellArray]:
    """Sort the cars that are to be looked up, and fill the rows of those that wait without a task where they were sent.

    Returns:
        Cars that are held back where they were sent, others that are there, and those that are away from it.
    """
    sorts = np.empty((3, len(phase)), dtype=np.int32)
    n = np.zeros(3, dtype=np.int64)
    for car in range(len(phase)):
        if rows[car, _CAUSE] != _LOOK_UP:
            continue
        sort = 2
        if goals[car] < 0 or tails[car] == goals[car]:
            sort = 0 if phase[car] == _HELD_PHASE else 1
            parked[car] = sort == 0 or phase[car] == _IDLE_PHASE
            if phase[car] == _IDLE_PHASE:
                for column in range(rows.shape[1]):
                    rows[car, column] = without_task[car, column]
                continue
        sorts[sort, n[sort]] = car
        n[sort] += 1
    return sorts[0, : n[0]], sorts[1, : n[1]], sorts[2, : n[2]]


@njit(cache=True)
def _look_at_next_cells(
    rows: CauseRows,
    cars: CellArray,
    cells: CellArray,
    holder: CellArray,
    line_first: CellArray,
    visit_agent: CellArray,
    landed_goals: CellArray,
    goals: CellArray,
) -> CellArray:
    """Fill the rows of cars before their next cells, but for their tasks and places; returns those that await a plan.

    That another car comes first counts if the last plan knew where a car is to go.
    """
    late = np.empty(len(cars), dtype=np.int32)
    n = 0
    for k in range(len(cars)):
        car, cell = cars[k], cells[k]
        if cell < 0:
            continue
        first = visit_agent[line_first[cell]] if line_first[cell] >= 0 else NOBODY
        if holder[cell] >= 0 and holder[cell] != car:
            cause, by = _CELL, holder[cell]
        elif first >= 0 and first != car and landed_goals[car] == goals[car]:
            cause, by = _YIELDS, first
        else:
            cause, by, cell = _PLAN_LATE, NONE, NONE
            late[n] = car
            n += 1
        rows[car, _CAUSE] = cause
        rows[car, _BY] = by
        rows[car, _AT] = cell
        rows[car, _UNTIL] = NONE
        rows[car, _DETAIL] = 0
    return late[:n]


@njit(cache=True)
def _leave_out_free_arms(rows: CauseRows, n_cars: int) -> None:
    """Nothing keeps a car from an arm that is free and awaits it, or that has a dock closed: in a moment it is open."""
    for car in range(n_cars):
        arm = rows[car, _BY]
        if arm < n_cars:
            continue
        free = rows[arm, _CAUSE] == _AWAITS or rows[arm, _CAUSE] == _NO_TASK
        if rows[arm, _BY] == car or (free and rows[car, _CAUSE] == _CLOSED):
            rows[car, _CAUSE], rows[car, _BY] = _SETS_OFF, NONE
