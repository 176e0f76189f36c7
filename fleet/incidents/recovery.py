"""Recovery: a car that has left its lane stops and rejoins a free state nearby; a dead one keeps only its ground."""

from __future__ import annotations

import math
from collections import defaultdict
from dataclasses import dataclass, field
from enum import StrEnum
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from fleet.arrays import FloatArray
from fleet.incidents.pivoting import pivot_back
from fleet.incidents.rejoin_room import (
    LEAST_MARGIN_M,
    MARGIN_M,
    SEARCH_M,
    SWING_M,
    RejoinRoom,
    cell_of,
    outline,
)
from fleet.missions.phases import CarPhase
from fleet.robots.angle import wrapped
from fleet.run.view import RunView
from fleet.traffic.drivers import OFF_LANE_M, PathDriver
from maps.vehicle import TURN_M_PER_RAD
from planners.motion.car.reeds_shepp import RejoinResult, plan_rejoin

EMPTY = "battery_empty"
"""What keeps a car dead whose battery is empty, until it is changed."""
SERVED_S = 10.0
"""A wreck is taken note of when the arm over it has ended its work, and after so long at the latest [s]."""
TURNING_RADIUS_M = 0.45
"""A little wider than the lanes' arcs, so that the follower has room to correct."""
WIDE_RADII_M = (1.0, 2.0)
"""Of curves that are tried beside a wall: in a tight one the tail swings into it."""
LEADS_M = (
    (1.2, 40.0, 2.4),
    (1.2, -40.0, 2.4),
    (0.8, 15.0, 0.8),
    (0.8, -15.0, 0.8),
    (1.2, 15.0, 1.2),
    (1.2, -15.0, 1.2),
    (0.3, math.inf, 0.3),
    (-0.3, math.inf, 0.3),
)
"""Driven at first by a car beside a wall, so that its tail is off it when it swings: length, negative backwards;
radius, positive to the left; and how much farther than else the car may go before it must have left the wall. In curves
of 40 and 15 m the tail swings by 0.2 and 0.6 mm, and is 2 to 5 cm off the wall at their end."""
N_STATES, N_SEARCHED = 12, 3
"""States that direct curves are tried to, and how many of them a search is tried to if none is free."""
ITERATIONS = 300
"""Budget of one search; it ends in 0.2 s."""
LOOK_TICKS = 10
"""Ticks between two looks at cars that have no move, and should stand at their stops."""
STILL_MPS, STILL_S = 0.05, 0.5
"""A car has stopped when it was this slow for this long."""
SETTLED_S = 3.0
"""One that may touch something stands so long before it moves [s]: then it knows to 0.3 mm where it is, not to 2."""
MANOEUVRE_MPS = 0.5
JOIN_M = 0.08
"""A manoeuvre that ends farther than this from its state is repeated."""
SHIFTED_M, SHIFTED_RAD = 0.06, 0.2
"""A dead car that is farther than this from where it came to rest was pushed; noise of the estimate stays below."""
RETRY_S, RETRY_MAX_S = 2.0, 10.0
"""Wait before the next attempt when there is no way back yet; doubles with every attempt."""
N_PATIENT, N_TRIES = 2, 14
"""Attempts that a car makes as things are, and all of them. After the first ones it keeps others away, those that stand
because of it have to find ways of their own, and it makes do with less room; after two minutes it is lost."""
KEPT_AWAY_M = 1.5
"""How far around it a car that has found no way back lets nobody new come near."""


class _Stage(StrEnum):
    STOPPING = "stopping"
    DRIVING = "driving"


@dataclass(kw_only=True)
class _Rejoin:
    stage: _Stage
    still_since: int
    retry_tick: int = 0
    starts_tick: int = 0
    """When its wheels are turned to where its manoeuvre begins, and it moves off."""
    retry_s: float = RETRY_S
    target: int = -1
    n_failed: int = 0
    """Attempts in vain since it stands."""
    taken: bool = False
    """Whether an operator drives it."""
    closed: list[int] = field(default_factory=list)
    """Cells that others are kept out of."""
    halted: set[int] = field(default_factory=set)
    """Cars that stand because their granted way leads through this one."""


@dataclass(kw_only=True)
class _Wreck:
    still_since: int
    pose: FloatArray | None = None
    """Where it came to rest; None while it rolls."""
    halted: set[int] = field(default_factory=set)
    """Cars that stand because their granted way leads through it."""


@dataclass(frozen=True, kw_only=True)
class _Attempt:
    """How a way to the states nearby is looked for."""

    room: RejoinRoom
    radius_m: float = TURNING_RADIUS_M
    lead_m: float = 0.0
    lead_radius_m: float = math.inf
    iterations: int = 0


def _patient(room: RejoinRoom) -> list[_Attempt]:
    """Directly, else around what is in the way; off what it touches without a touch."""
    led = _led(room) if room.touches else ()
    return [*_leaving(room), _Attempt(room=room), *led, _Attempt(room=room, iterations=ITERATIONS)]


def _impatient(room: RejoinRoom) -> list[_Attempt]:
    """Off a wall without a touch, if there is such a way; else with the tail that much nearer to it."""
    swinging = room.eased(swing_m=SWING_M)
    wide = [_Attempt(room=swinging, radius_m=radius_m) for radius_m in WIDE_RADII_M]
    around = [_Attempt(room=swinging), _Attempt(room=swinging, iterations=ITERATIONS)]
    return [*_leaving(room), _Attempt(room=room), *_led(room), *around, *wide]


def _leaving(room: RejoinRoom) -> list[_Attempt]:
    """Off what it touches at once, as a car can that touches it with a corner: directly, or straight at first."""
    if not room.touches:
        return []
    leaving = room.leaving()
    straight = [lead for lead in LEADS_M if math.isinf(lead[1])]
    return [
        _Attempt(room=leaving),
        *(_Attempt(room=leaving.eased(lead_m=out_m), lead_m=lead_m) for lead_m, _, out_m in straight),
    ]


def _led(room: RejoinRoom) -> list[_Attempt]:
    """Straight or in a wide curve at first."""
    return [
        _Attempt(room=room.eased(lead_m=out_m), radius_m=radius_m, lead_m=lead_m, lead_radius_m=lead_radius_m)
        for lead_m, lead_radius_m, out_m in LEADS_M
        for radius_m in ((TURNING_RADIUS_M,) if math.isfinite(lead_radius_m) else (TURNING_RADIUS_M, *WIDE_RADII_M))
    ]


class Recovery:
    """Brings cars back onto the lane graph.

    Args:
        run: The run whose cars are watched.
    """

    def __init__(self, run: RunView) -> None:
        self._run = run
        self._rejoining: dict[int, _Rejoin] = {}
        self._wrecks: dict[int, _Wreck] = {}
        self._kept_dead_by: defaultdict[int, set[str]] = defaultdict(set)

    def lose_car(self, car: int, reason: str, by: str = "") -> None:
        """Take a car out of the run for good, unless it is out already: it rolls out and stays where it is.

        Args:
            car: The car.
            reason: Why, in words.
            by: What has to end before the car can be alive again, such as a kind of event, or the arm that stands dead
                over it; empty = nothing.
        """
        run = self._run
        if by:
            self._kept_dead_by[car].add(by)
        if run.missions.phase[car] is CarPhase.DEAD:
            return
        run.driver.stop(car)
        run.executor.halt(car)
        run.dispatcher.rules.interventions.retire(car, CarPhase.DEAD, run.sim_s, reason)
        self.abandon(car)
        run.events.log("car_lost", car=f"car_{car}", cause=reason)

    def revive(self, car: int, by: str) -> None:
        """A dead car is alive again, with nothing in its tray: it comes back into service.

        A pod on its plate is put back, unless something stands where it belongs: such a car takes no task.

        Args:
            car: The car; it stays dead as long as anything else keeps it so.
            by: What has ended.
        """
        run = self._run
        self._kept_dead_by[car].discard(by)
        if car not in self._wrecks or self._kept_dead_by[car]:
            return
        wreck, paths = self._wrecks.pop(car), run.driver.paths
        run.inventory.empty_tray(car)
        run.traffic.set_alive(car)
        run.visits.bring_pod_home(car)
        run.events.log("car_revived", car=f"car_{car}")
        run.missions.enter(car, CarPhase.RECOVERING)
        if paths is None:
            run.driver.go(car)
            self._resume(car, run.now)
            return
        self._let_go(paths, wreck.halted)
        self._rejoining[car] = _Rejoin(stage=_Stage.STOPPING, still_since=run.now)

    def tow(self, car: int) -> bool:
        """Pull a dead car to the nearest free parking place, without what lies in its tray or on its plate.

        Args:
            car: The car.

        Returns:
            Whether that is done, or nothing was to be done; False if no place is free, something stands where its pod
            belongs, or it does not lie still yet.
        """
        run = self._run
        wreck = self._wrecks.get(car)
        if wreck is None or wreck.pose is None or wreck.halted or run.services.is_served(car):
            return wreck is None  # who is not dead is not towed; a wreck is when it lies still and no arm is over it
        graph, held = run.graph, run.executor.dependencies.holders()
        free = [
            s
            for s in run.places.parking
            if held[graph.state_cell[s]] < 0 and not run.traffic.blocked[graph.state_cell[s]]
        ]
        if not free or not run.visits.bring_pod_home(car):
            return False
        offset = graph.state_pose[free, :2] - wreck.pose[:2]
        state = free[int(np.argmin(np.hypot(*offset.T)))]
        run.inventory.empty_tray(car)
        run.world.put_car(car, graph.state_pose[state])
        run.driver.give_up(car)
        run.traffic.set_dead(car, [])
        run.events.log("car_towed", car=f"car_{car}", state=state)
        run.executor.dependencies.reserve(car, (int(graph.state_cell[state]),))
        return True

    def take(self, car: int) -> bool:
        """Leave a car to an operator until `give_back`; False if it is in trouble, or served, at present."""
        run = self._run
        if car in self._rejoining or car in self._wrecks or run.services.is_served(car):
            return False
        if run.driver.paths is None:
            run.driver.hindrances.hold(car)
            return True
        self._begin(run.driver.paths, car, run.now, f"an operator drives car_{car}")
        self._rejoining[car].taken = True
        return True

    def give_back(self, car: int) -> None:
        """An operator has parked a car, and it comes back to its lane."""
        if self._run.driver.paths is None:
            self._run.driver.hindrances.let_go(car)
        elif car in self._rejoining:
            self._rejoining[car].taken = False
            self._rejoining[car].still_since = self._run.now

    def abandon(self, car: int) -> None:
        """A car died: it rolls out, and then only the cells it stands in are lost, wherever it is pushed later."""
        rejoin = self._rejoining.pop(car, None)
        paths = self._run.driver.paths
        if rejoin is not None and paths is not None:
            self._let_go(paths, rejoin.halted)
            self._open(rejoin)
        self._run.traffic.set_dead(car, [])
        self._wrecks.setdefault(car, _Wreck(still_since=self._run.now))

    @property
    def active(self) -> bool:
        """True when a car is off its lane or dead."""
        return bool(self._rejoining or self._wrecks)

    def halted_by(self) -> dict[int, int]:
        """Cars that stand because their granted way leads through another one, and that one."""
        stopped: dict[int, _Rejoin | _Wreck] = {**self._wrecks, **self._rejoining}
        return {other: car for car, obstacle in stopped.items() for other in obstacle.halted}

    def tick(self, tick: int) -> None:
        """Notice cars that are off their lane, and move those that are being recovered on by one step."""
        driver = self._run.driver.paths
        for car, wreck in self._wrecks.items():
            self._watch(car, wreck, tick)
        if driver is None:
            self._put_back(tick)
            return
        for car in [*driver.off_lane(), *self._off_stop(driver, tick)]:
            if self._run.missions.phase[car] is CarPhase.DEAD:
                continue
            rejoin = self._rejoining.get(car)
            if rejoin is None:
                self._begin(driver, car, tick, f"car_{car} left its lane")
            elif rejoin.stage is _Stage.DRIVING:
                driver.stop(car)
                rejoin.stage, rejoin.still_since = _Stage.STOPPING, tick
        for car, rejoin in list(self._rejoining.items()):
            if rejoin.stage is _Stage.STOPPING:
                self._hold_ground(driver, car, rejoin)
                if not rejoin.taken:
                    self._try(driver, car, rejoin, tick)
            elif tick == rejoin.starts_tick:
                driver.go(car, MANOEUVRE_MPS)
            elif driver.at_rest(car):
                self._end(driver, car, rejoin, tick)

    def _off_stop(self, driver: PathDriver, tick: int) -> list[int]:
        """Cars without a move that do not stand where they should: pushed along their lane."""
        run = self._run
        if tick % LOOK_TICKS:
            return []
        executor = run.executor
        stops = run.graph.state_pose[executor.tail_states()]
        stands = executor.without_moves() & (np.abs(run.world.car_speeds()) < STILL_MPS)
        return [car for car in driver.off_stop(stops, stands) if car not in self._rejoining]

    def _put_back(self, tick: int) -> None:
        """On the grid, where there is nothing between two states, let cars that were pushed stand in theirs again."""
        run = self._run
        if tick % LOOK_TICKS:
            return
        stops = run.graph.state_pose[run.executor.tail_states()]
        off_m = np.hypot(*(run.driver.estimate - stops)[:, :2].T)
        for car in np.flatnonzero(run.executor.without_moves() & (off_m > OFF_LANE_M)).tolist():
            if run.missions.phase[car] is CarPhase.DEAD or run.services.is_served(car):
                continue
            run.world.put_car(car, stops[car])
            run.driver.give_up(car)
            run.driver.go(car)
            run.events.log("rejoined", car=f"car_{car}", state=int(run.executor.tail_states()[car]))

    def _begin(self, driver: PathDriver, car: int, tick: int, reason: str) -> None:
        run = self._run
        driver.stop(car)
        run.executor.halt(car)
        run.traffic.set_fixed(car, True)
        run.dispatcher.rules.interventions.retire(car, CarPhase.RECOVERING, run.sim_s, reason)
        x, y, yaw = driver.estimate[car].tolist()
        run.events.log("off_lane", car=f"car_{car}", x=round(x, 3), y=round(y, 3), yaw=round(wrapped(yaw), 3))
        self._rejoining[car] = _Rejoin(stage=_Stage.STOPPING, still_since=tick)

    def _watch(self, car: int, wreck: _Wreck, tick: int) -> None:
        """Let a dead car roll out, or slide after a push, and then give back all cells but those under it."""
        run = self._run
        driver, pose = run.driver, run.driver.estimate[car]
        if wreck.pose is not None:
            turned = abs(np.arctan2(np.sin(pose[2] - wreck.pose[2]), np.cos(pose[2] - wreck.pose[2])))
            if np.hypot(*(pose - wreck.pose)[:2]) < SHIFTED_M and turned < SHIFTED_RAD:
                return
            wreck.pose, wreck.still_since = None, tick
            run.traffic.set_dead(car, [])  # nothing is cut off for good by what moves
        if driver.paths is not None:
            self._hold_ground(driver.paths, car, wreck)
        if np.abs(run.world.car_speeds()[car]) > STILL_MPS:
            wreck.still_since = tick
        if (tick - wreck.still_since) * run.tick_s < (SERVED_S if run.services.is_served(car) else STILL_S):
            return
        wreck.pose = pose.copy()
        self._settle(car)
        if driver.paths is not None:
            # Their way leads through the wreck: they have to find another.
            for other in wreck.halted - self._rejoining.keys():
                self._begin(driver.paths, other, tick, f"car_{car} lies in the way of car_{other}")
            wreck.halted = set()

    def _settle(self, car: int) -> None:
        """Make the cells under a dead car that nobody else holds all that it has."""
        run = self._run
        dependencies, graph = run.executor.dependencies, run.graph
        pose = run.driver.estimate[car]
        ground = self._cells_of(car, pose[None])
        dependencies.unreserve(car)
        own = [cell for cell in ground if dependencies.reserve(car, (cell,))]
        kind = graph.states_like(int(run.executor.tail_states()[car]))
        states = np.flatnonzero(np.isin(graph.state_cell[kind], own)) + kind.start
        if states.size:
            offset = graph.state_pose[states, :2] - pose[:2]
            run.driver.give_up(car)
            run.executor.relocate(car, int(states[np.argmin(np.hypot(*offset.T))]))
        # Pushed off all lanes it keeps its last cell there: the graph knows no other place for it.
        taken = sorted({*ground, *dependencies.held_cells(car)})
        for cell in taken:
            dependencies.avoid(cell)
        run.traffic.set_dead(car, taken)
        run.events.log("wreck", car=f"car_{car}", cells=taken)

    def _hold_ground(self, driver: PathDriver, car: int, stopped: _Rejoin | _Wreck) -> None:
        """Let nobody into the cells a car has come to stand in; those who were granted one already have to wait."""
        dependencies = self._run.executor.dependencies
        halted = set()
        for cell in self._cells_of(car, driver.estimate[car][None]):
            if not dependencies.reserve(car, (cell,)):
                halted |= {other for other in self._others(car) if cell in dependencies.held_cells(other)}
        before, stopped.halted = stopped.halted, halted - self._rejoining.keys() - self._wrecks.keys()
        for other in stopped.halted - before:
            driver.stop(other)
        self._let_go(driver, before - stopped.halted)

    def _let_go(self, driver: PathDriver, cars: set[int]) -> None:
        """Let cars go on, but for those that are in trouble themselves or wait for yet another."""
        stopped: list[_Rejoin | _Wreck] = [*self._rejoining.values(), *self._wrecks.values()]
        for other in cars - self._rejoining.keys() - self._wrecks.keys():
            if not any(other in obstacle.halted for obstacle in stopped):
                driver.go(other)

    def _try(self, driver: PathDriver, car: int, rejoin: _Rejoin, tick: int) -> None:
        run = self._run
        speeds = np.abs(run.world.car_speeds())
        if speeds[[car, *rejoin.halted]].max() > STILL_MPS:
            rejoin.still_since = tick
        still_s = (tick - rejoin.still_since) * run.tick_s
        if still_s < STILL_S or tick < rejoin.retry_tick or run.services.is_served(car):
            return
        patient = rejoin.n_failed <= N_PATIENT
        usable = self._usable_cells(car)
        room = RejoinRoom(run, car, driver.estimate[car], usable, MARGIN_M if patient else LEAST_MARGIN_M)
        if room.touches and still_s < SETTLED_S:
            rejoin.retry_tick = rejoin.still_since + round(SETTLED_S / run.tick_s)
            return
        found = self._plan(car, room, run.config.seed + tick, patient=patient)
        if found is None:
            self._fail(driver, car, rejoin, tick)
            return
        rejoin.target, way = found
        self._lay_out(driver, car, way)
        turns_s = run.scene.cars[car].lock_to_lock_s
        rejoin.stage, rejoin.starts_tick = _Stage.DRIVING, tick + max(1, round(turns_s / run.tick_s))
        run.events.log("rejoin", car=f"car_{car}", state=rejoin.target, length_m=round(way.length_m, 2))

    def _fail(self, driver: PathDriver, car: int, rejoin: _Rejoin, tick: int) -> None:
        """There is no way back at present: wait, then make room, and give up in the end."""
        run = self._run
        rejoin.n_failed += 1
        if rejoin.n_failed == N_TRIES:
            self.lose_car(car, f"car_{car} found no way back to its lane")
            return
        run.events.log("rejoin_impossible", car=f"car_{car}", retry_s=rejoin.retry_s)
        rejoin.retry_tick = tick + round(rejoin.retry_s / run.tick_s)
        rejoin.retry_s = min(2 * rejoin.retry_s, RETRY_MAX_S)
        if rejoin.n_failed < N_PATIENT:
            return
        if not rejoin.closed:
            rejoin.closed = self._cells_around(driver.estimate[car])
            for cell in rejoin.closed:
                run.executor.close(cell)
        for other in sorted(rejoin.halted - self._rejoining.keys() - self._wrecks.keys()):
            self._begin(driver, other, tick, f"car_{car} stands in the way of car_{other}")

    def _open(self, rejoin: _Rejoin) -> None:
        """Let others come near again."""
        for cell in rejoin.closed:
            self._run.executor.open(cell)
        rejoin.closed = []

    def _cells_around(self, pose: FloatArray) -> list[int]:
        """Cells whose middles are near a pose."""
        grid = self._run.site.grid
        offset = grid.cell_xy(np.arange(grid.n_cells)) - pose[:2]
        return np.flatnonzero(np.hypot(*offset.T) < KEPT_AWAY_M).tolist()

    def _plan(self, car: int, room: RejoinRoom, seed: int, *, patient: bool) -> tuple[int, RejoinResult] | None:
        """A state to rejoin and a way to it whose cells are the car's from now on; None if there is none at present."""
        run, start = self._run, room.start
        states = self._near_states(car, start, room.usable)
        for state in states if run.scene.cars[car].footprint.pivots else ():
            turned = pivot_back(start, run.graph.state_pose[state], room.valid)
            if turned is not None and self._reserve(car, turned, room):
                return state, turned
        for attempt in _patient(room) if patient else _impatient(room):
            for state in states[: N_SEARCHED if attempt.iterations else N_STATES]:
                way = plan_rejoin(
                    start,
                    run.graph.state_pose[state],
                    attempt.radius_m,
                    attempt.room.valid,
                    seed=seed,
                    max_iterations=attempt.iterations,
                    lead_m=attempt.lead_m,
                    lead_radius_m=attempt.lead_radius_m,
                )
                if not way.solved:
                    continue
                if self._reserve(car, way, room):
                    return state, way
        return None

    def _reserve(self, car: int, way: RejoinResult, room: RejoinRoom) -> bool:
        """Make the cells of a manoeuvre the car's own, if nobody has one of them."""
        cells = [cell for cell in self._cells_of(car, way.poses) if cell not in room.ground]
        return self._run.executor.dependencies.reserve(car, cells)

    def _lay_out(self, driver: PathDriver, car: int, way: RejoinResult) -> None:
        """Lay a manoeuvre out before a car that stands.

        It moves off only when its wheels are turned: while they turn a car swings whichever way they stood before.
        """
        driver.restart(car)
        driver.stop(car)
        cusps = np.nonzero(np.diff(way.directions))[0] + 1
        bounds = [0, *cusps.tolist(), len(way.poses) - 1]
        for a, b in pairwise(bounds):
            part = way.poses[a : b + 1]
            if len(part) > 1:
                steps_m = np.hypot(np.diff(part[:, 0]), np.diff(part[:, 1]))
                steps_m = np.where(steps_m > 0.0, steps_m, TURN_M_PER_RAD * np.abs(np.diff(part[:, 2])))
                s_m = np.concatenate(([0.0], np.cumsum(steps_m)))
                driver.append_points(car, part, s_m, int(way.directions[a]))

    def _end(self, driver: PathDriver, car: int, rejoin: _Rejoin, tick: int) -> None:
        run = self._run
        goal = run.graph.state_pose[rejoin.target]
        if np.hypot(*(driver.estimate[car] - goal)[:2]) > JOIN_M:
            rejoin.stage, rejoin.still_since = _Stage.STOPPING, tick
            return
        del self._rejoining[car]
        self._let_go(driver, rejoin.halted)
        self._open(rejoin)
        driver.restart(car, goal)
        run.executor.relocate(car, rejoin.target)
        self._resume(car, tick)
        run.events.log("rejoined", car=f"car_{car}", state=rejoin.target)

    def _resume(self, car: int, tick: int) -> None:
        """A car stands in a state of the lane graph and goes on with what it was about."""
        run = self._run
        run.executor.dependencies.unreserve(car)
        run.traffic.set_fixed(car, False)
        run.dispatcher.rules.interventions.resume(car, tick, run.sim_s)

    def _others(self, car: int) -> list[int]:
        return [other for other in range(self._run.world.n_cars) if other != car]

    def _usable_cells(self, car: int) -> npt.NDArray[np.bool_]:
        """Free cells that no other car holds and nobody walks in, shape (rows, cols)."""
        run = self._run
        grid = run.site.grid
        usable = grid.free.copy().ravel()
        usable &= ~(run.traffic.blocked | (run.executor.n_walkers > 0))
        for other in self._others(car):
            usable[run.executor.dependencies.held_cells(other)] = False
        return usable.reshape(grid.rows, grid.cols)

    def _near_states(self, car: int, pose: FloatArray, usable: npt.NDArray[np.bool_]) -> list[int]:
        graph = self._run.graph
        kind = graph.states_like(int(self._run.executor.tail_states()[car]))
        offset = graph.state_pose[kind] - pose
        distance = np.hypot(offset[:, 0], offset[:, 1])
        turn = np.abs(np.arctan2(np.sin(offset[:, 2]), np.cos(offset[:, 2])))
        near = np.nonzero((distance < SEARCH_M) & usable.ravel()[graph.state_cell[kind]])[0]
        order = np.lexsort((near, distance[near] + 0.5 * turn[near]))
        return (near[order][:N_STATES] + kind.start).tolist()

    def _cells_of(self, car: int, poses: FloatArray) -> list[int]:
        """Cells under the body of a car at any of the poses."""
        grid = self._run.site.grid
        row, col = cell_of(
            outline(poses, self._run.scene.cars[car].footprint, 0.0).reshape(-1, 2), grid.rows, grid.cell_m
        )
        on_map = (row >= 0) & (row < grid.rows) & (col >= 0) & (col < grid.cols)
        return np.unique((row * grid.cols + col)[on_map]).tolist()
