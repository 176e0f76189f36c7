"""Kernels of `GridFleet`: what a timestep changes besides the cars' states - services, tasks, bookings, goals.

They write the rules of a run again, for speed; `tests/contract/test_grid_rules.py` holds every step that they let a
task or a car make against the life cycle of runs.
"""

from __future__ import annotations

import math
from enum import IntEnum
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from fleet.abstract.compiled import compiled, inlined

Ints = npt.NDArray[np.int32]
SmallInts = npt.NDArray[np.int8]
Bools = npt.NDArray[np.bool_]
Distances = npt.NDArray[np.uint16]

NONE = -1
NEVER = np.iinfo(np.int32).max


class Phase(IntEnum):
    """What a car is about, as agents are told."""

    FREE = 0
    TO_PICK = 1
    LOADING = 2
    TO_DROP = 3
    UNLOADING = 4
    OUT = 5
    """Out of service."""
    CHARGING = 6
    """Has too little charge for a task: on the way to a charger, waiting for one, or at it."""


class Stage(IntEnum):
    """Where a task stands."""

    ORDERED = 0
    READY = 1
    """Released; as no delivery waits for another, a car may be given it at once."""
    ASSIGNED = 2
    CARRIED = 3
    DELIVERED = 4
    WITHDRAWN = 5
    """A car has another task of the same order."""


# numba reads plain integers faster than members of an enum.
FREE, TO_PICK, LOADING, TO_DROP, UNLOADING, OUT, CHARGING = (int(phase) for phase in Phase)
READY, ASSIGNED, CARRIED, DELIVERED, WITHDRAWN = (int(stage) for stage in list(Stage)[1:])


class Floor(NamedTuple):
    """What never changes; S states, k stations, p parking places."""

    distance: Distances
    """Timesteps to the goals, a row for each, shape (n_rows, S)."""
    dock_state: Ints
    dock_row: Ints
    """State of each station's dock and its row of `distance`, shape (k,)."""
    spot_state: Ints
    spot_row: Ints
    """The same for the parking places, shape (p,)."""
    charger_state: Ints
    charger_row: Ints
    """The same for the chargers, shape (c,)."""
    service_steps: int
    """Timesteps that a car is served, of stations all alike."""
    load_steps: Ints
    unload_steps: Ints
    """Timesteps that a car is served at each station, by what is done there, shape (k,)."""
    cycle_steps: Ints
    """Timesteps from the beginning of a service to that of the next, at least, shape (k,)."""
    station_cap: Ints
    """Cars that are near each station at once, the one that is served included, shape (k,); at a pick station each of
    them takes a slot for its parcel until that is loaded, so there are no more than it has slots."""
    near_moves: int
    """A car with at most so many moves left to its station needs a booking to go on."""
    loaded_rank: int
    urgent_rank: int
    """Head start in the right of way of a car with a parcel, and of one with an urgent task, in timesteps."""


class CarTable(NamedTuple):
    """One entry per car."""

    state: Ints
    phase: SmallInts
    held: Bools
    """Waits in a parking place until there is room at its station."""
    booked: Bools
    """Has a place near its station."""
    task: Ints
    station: Ints
    """Where it is bound for, or served."""
    spot: Ints
    """The parking place that is its own now."""
    charger: Ints
    """The charger that is its own now."""
    charge: npt.NDArray[np.float64]
    """What is in its battery, 1 = full."""
    left: Ints
    """Timesteps of service that are left, or of a breakdown; of a car that is out of service 0 = for good."""
    bound: Ints
    """Timestep in which it was bound for its station."""
    since: Ints
    """Timestep in which it was given its goal."""
    goal: Ints
    row: Ints
    """Its goal, and the row of distances to it."""


class TaskTable(NamedTuple):
    """One entry per task, ascending in release; times in timesteps.

    An order has a task for each pick station that has what is ordered, one after the other, of which one is done.
    """

    release: Ints
    due: Ints
    """`NEVER` = any time."""
    pick: Ints
    drop: Ints
    rank: SmallInts
    """Priority class, 0 = most urgent."""
    stage: SmallInts
    car: Ints
    done: Ints
    """Timestep of the delivery, `NEVER` before."""
    order: Ints
    """The first task of the same order."""
    window: Ints
    """First task that may be open, and number of those released, shape (2,)."""


class StationTable(NamedTuple):
    """One entry per station."""

    booked: Ints
    """Cars that have a place near it; at a pick station also the slots that their parcels take."""
    under_way: Ints
    """Tasks whose cars have still to come to it."""
    free_at: Ints
    """Timestep from which on its arm can serve the next car."""


class Counts(NamedTuple):
    """What has happened since it was last asked; whole numbers on the grid."""

    delivered: npt.NDArray[Any]
    """Deliveries of each car."""
    late: npt.NDArray[Any]
    """Timesteps by which its deliveries were late."""
    empty: npt.NDArray[Any]
    """Moves it made on its way to a pick station."""
    open: npt.NDArray[Any]
    """Sum over the timesteps of the orders that were released and not picked, shape (1,)."""

    @staticmethod
    def of(n_cars: int, dtype: npt.DTypeLike) -> Counts:
        """Counts of nothing yet."""
        delivered, late, empty = (np.zeros(n_cars, dtype=dtype) for _ in range(3))
        return Counts(delivered=delivered, late=late, empty=empty, open=np.zeros(1, dtype=dtype))

    def forget(self) -> None:
        """Begin anew."""
        for count in self:
            count[:] = 0


class Faults(NamedTuple):
    """How often cars break down."""

    rate: float
    """Chance of each car in each timestep; 0 = never."""
    mean_steps: float
    """Timesteps for which a car stands then, on average."""
    lost_share: float
    """Part of the breakdowns of cars without a parcel after which a car drives but takes no task any more."""


NO_FAULTS = Faults(rate=0.0, mean_steps=0.0, lost_share=0.0)
"""Nothing ever breaks down."""


class Battery(NamedTuple):
    """What a timestep takes and gives."""

    drain: float
    """Charge that a car with a task uses in a timestep; 0 = cars have no batteries."""
    gain: float
    """Charge that a car gains in a timestep at a charger."""


NO_BATTERY = Battery(drain=0.0, gain=0.0)
"""Cars work for ever."""
LOW, ENOUGH = 0.2, 0.6
"""Charge below which a car is given no task, and from which on it is given some again."""


@compiled
def charge_up(floor: Floor, cars: CarTable, battery: Battery) -> None:  # pragma: no cover - compiled
    """Use and load batteries for a timestep, and give out the chargers; after `serve`.

    A car without a task keeps its charger until it is full or is given a task. The emptiest ones choose first; one that
    has too little for a task takes the place of one that has enough.
    """
    if battery.drain == 0.0:
        return
    for car in range(len(cars.state)):
        phase, charger = cars.phase[car], cars.charger[car]
        if charger != NONE and cars.state[car] == floor.charger_state[charger]:
            cars.charge[car] = min(1.0, cars.charge[car] + battery.gain)
        elif phase in (TO_PICK, LOADING, TO_DROP, UNLOADING) and not cars.held[car]:
            cars.charge[car] = max(0.0, cars.charge[car] - battery.drain)
        if phase == FREE and cars.charge[car] < LOW:
            cars.phase[car] = CHARGING
        elif phase == CHARGING and cars.charge[car] >= ENOUGH:
            cars.phase[car] = FREE
        if cars.phase[car] not in (FREE, CHARGING) or cars.charge[car] >= 1.0:
            cars.charger[car] = NONE
    while True:
        car = _emptiest(cars)
        if car == NONE:
            break
        charger = _nearest_charger(floor, cars, cars.state[car])
        if charger == NONE and cars.phase[car] == CHARGING:
            charger = _cleared(cars)
        if charger == NONE:
            break
        cars.charger[car] = charger


@compiled
def break_down(
    cars: CarTable, tasks: TaskTable, stations: StationTable, faults: Faults, dice: int, now: int
) -> None:  # pragma: no cover - compiled
    """Let cars break down, and those that have stood long enough go on; before `serve`.

    A car that is served does not break down; one that drives to its pick station gives its task back. Chance is that of
    the car and the timestep, whatever the fleet does, so that all policies meet the same.

    Args:
        cars: The cars.
        tasks: The tasks.
        stations: The stations.
        faults: How often.
        dice: Source of chance.
        now: The timestep.
    """
    if faults.rate == 0.0:
        return
    for car in range(len(cars.state)):
        phase = cars.phase[car]
        if phase == OUT:
            if cars.left[car] > 0:
                cars.left[car] -= 1
                if cars.left[car] == 0:
                    cars.phase[car] = FREE if cars.task[car] == NONE else TO_DROP
            continue
        if phase in (LOADING, UNLOADING) or _chance(dice, now, car, 0) >= faults.rate:
            continue
        if phase == TO_PICK:
            _give_back(cars, tasks, stations, car)
        cars.phase[car] = OUT
        is_lost = cars.task[car] == NONE and _chance(dice, now, car, 1) < faults.lost_share
        stands = 1 + int(-faults.mean_steps * math.log(1.0 - _chance(dice, now, car, 2)))
        cars.left[car] = 0 if is_lost else stands


@compiled
def assign(
    cars: CarTable, tasks: TaskTable, stations: StationTable, car: int, task: int, now: int
) -> None:  # pragma: no cover
    """Give a ready task to a free car."""
    _set_order(tasks, task, WITHDRAWN)
    tasks.stage[task], tasks.car[task] = ASSIGNED, car
    cars.task[car] = task
    stations.under_way[tasks.pick[task]] += 1
    stations.under_way[tasks.drop[task]] += 1
    _bind(cars, car, TO_PICK, tasks.pick[task], now)


@compiled
def assign_nearest(
    floor: Floor, cars: CarTable, tasks: TaskTable, stations: StationTable, room: int, now: int
) -> None:  # pragma: no cover - compiled
    """Give each ready task, the most urgent class first, then the oldest, to the nearest free car."""
    n_free = 0
    for car in range(len(cars.state)):
        n_free += cars.phase[car] == FREE
    if n_free == 0:
        return
    for rank in range(3):
        for task in range(tasks.window[0], tasks.window[1]):
            if tasks.stage[task] != READY or tasks.rank[task] != rank:
                continue
            if stations.under_way[tasks.pick[task]] >= room or stations.under_way[tasks.drop[task]] >= room:
                continue
            distance = floor.distance[floor.dock_row[tasks.pick[task]]]
            nearest, least = NONE, NEVER
            for car in range(len(cars.state)):
                if cars.phase[car] == FREE and distance[cars.state[car]] < least:
                    nearest, least = car, distance[cars.state[car]]
            assign(cars, tasks, stations, nearest, task, now)
            n_free -= 1
            if n_free == 0:
                return


@compiled
def count_moves(cars: CarTable, after: Ints, counts: Counts) -> None:  # pragma: no cover - compiled
    """Count the moves to pick stations, and put the cars where they are after the timestep."""
    for car in range(len(after)):
        if after[car] != cars.state[car] and cars.phase[car] == TO_PICK:
            counts.empty[car] += 1
        cars.state[car] = after[car]


@compiled
def serve(
    floor: Floor, cars: CarTable, tasks: TaskTable, stations: StationTable, counts: Counts, now: int
) -> None:  # pragma: no cover - compiled
    """End and begin services, after a timestep's moves."""
    for car in range(len(cars.state)):
        phase = cars.phase[car]
        if phase in (LOADING, UNLOADING):
            cars.left[car] -= 1
            if cars.left[car] > 0:
                continue
            task = cars.task[car]
            stations.booked[cars.station[car]] -= 1
            stations.under_way[cars.station[car]] -= 1
            cars.booked[car] = False
            if phase == LOADING:
                tasks.stage[task] = CARRIED
                _bind(cars, car, TO_DROP, tasks.drop[task], now)
            else:
                tasks.stage[task], tasks.done[task] = DELIVERED, now
                counts.delivered[car] += 1
                if now > tasks.due[task]:
                    counts.late[car] += now - tasks.due[task]
                cars.phase[car], cars.task[car], cars.station[car] = FREE, NONE, NONE
        elif phase != OUT and cars.booked[car] and cars.state[car] == floor.dock_state[cars.station[car]]:
            station = cars.station[car]
            if now < stations.free_at[station]:
                continue
            cars.phase[car] = LOADING if phase == TO_PICK else UNLOADING
            cars.left[car] = floor.load_steps[station] if phase == TO_PICK else floor.unload_steps[station]
            stations.free_at[station] = now + floor.cycle_steps[station]


@compiled
def release(tasks: TaskTable, counts: Counts, now: int) -> None:  # pragma: no cover - compiled
    """Let orders come in: they are ready at once."""
    window = tasks.window
    while window[1] < len(tasks.release) and tasks.release[window[1]] <= now:
        tasks.stage[window[1]] = READY
        window[1] += 1
    while window[0] < window[1] and tasks.stage[window[0]] >= CARRIED:
        window[0] += 1
    for task in range(window[0], window[1]):
        stage = tasks.stage[task]
        counts.open[0] += stage == ASSIGNED or (stage == READY and tasks.order[task] == task)


@compiled
def direct(
    floor: Floor, cars: CarTable, stations: StationTable, spot_user: Ints, first: Ints, now: int
) -> None:  # pragma: no cover - compiled
    """Book places near stations, hold back cars without one, and give every car its goal.

    Args:
        floor: What never changes.
        cars: The cars.
        stations: The stations.
        spot_user: Car whose own each parking place is, or `NONE`, shape (p,).
        first: Working memory, shape (k,).
        now: The timestep.
    """
    n = len(cars.state)
    # Of the cars that want a place near a station, the one that has been bound for it longest.
    first[:] = NONE
    for car in range(n):
        station = cars.station[car]
        if cars.booked[car] or station == NONE or stations.booked[station] >= floor.station_cap[station]:
            continue
        if cars.phase[car] == OUT:
            continue
        near = floor.distance[floor.dock_row[station], cars.state[car]] <= floor.near_moves
        before = first[station] == NONE or cars.bound[car] < cars.bound[first[station]]
        if (cars.held[car] or near) and before:
            first[station] = car
    for station in range(len(first)):
        if first[station] != NONE:
            cars.booked[first[station]] = True
            cars.held[first[station]] = False
            stations.booked[station] += 1
    for car in range(n):
        phase, station = cars.phase[car], cars.station[car]
        if phase in (LOADING, UNLOADING):
            continue
        if station != NONE and not cars.booked[car]:
            near = floor.distance[floor.dock_row[station], cars.state[car]] <= floor.near_moves
            cars.held[car] = cars.held[car] or near
        if station != NONE and not cars.held[car]:
            if cars.spot[car] != NONE:
                spot_user[cars.spot[car]] = NONE
                cars.spot[car] = NONE
            goal, row = floor.dock_state[station], floor.dock_row[station]
        elif station == NONE and cars.charger[car] != NONE:
            if cars.spot[car] != NONE:
                spot_user[cars.spot[car]] = NONE
                cars.spot[car] = NONE
            goal, row = floor.charger_state[cars.charger[car]], floor.charger_row[cars.charger[car]]
        else:
            if cars.spot[car] == NONE:
                cars.spot[car] = _nearest_spot(floor, spot_user, cars.state[car])
                spot_user[cars.spot[car]] = car
            goal, row = floor.spot_state[cars.spot[car]], floor.spot_row[cars.spot[car]]
        if cars.goal[car] != goal:
            cars.goal[car], cars.row[car], cars.since[car] = goal, row, now


@compiled
def rank_cars(
    floor: Floor, cars: CarTable, tasks: TaskTable, now: int, priority: npt.NDArray[np.float64], locked: Bools
) -> None:  # pragma: no cover - compiled
    """Fill in which cars go first, larger = earlier, and which do not move.

    The priority is the time since the car was given its goal, with a head start for parcels and urgent tasks; a car
    that is where it should be comes last. Of equal ones the car with the lower index goes first.
    """
    for car in range(len(cars.state)):
        phase = cars.phase[car]
        at_goal = cars.state[car] == cars.goal[car]
        stands = phase in (LOADING, UNLOADING) or (phase == OUT and cars.left[car] > 0)
        locked[car] = stands or (at_goal and cars.booked[car])
        waited = np.float64(now - cars.since[car])
        if phase == TO_DROP:
            waited += floor.loaded_rank
        if cars.task[car] != NONE and tasks.rank[cars.task[car]] == 0:
            waited += floor.urgent_rank
        priority[car] = -1.0 if at_goal else waited


@inlined
def _bind(cars: CarTable, car: int, phase: int, station: int, now: int) -> None:  # pragma: no cover - compiled
    cars.phase[car], cars.station[car], cars.bound[car] = phase, station, now
    cars.held[car] = cars.booked[car] = False


@inlined
def _set_order(tasks: TaskTable, task: int, stage: int) -> None:  # pragma: no cover - compiled
    """Put all tasks of a task's order in a stage."""
    order = tasks.order[task]
    other = order
    while other < len(tasks.order) and tasks.order[other] == order:
        tasks.stage[other] = stage
        other += 1


@inlined
def _give_back(cars: CarTable, tasks: TaskTable, stations: StationTable, car: int) -> None:  # pragma: no cover
    """Take its task from a car that drives to its pick station. Compiled."""
    task = cars.task[car]
    _set_order(tasks, task, READY)
    tasks.car[task] = NONE
    tasks.window[0] = min(tasks.window[0], tasks.order[task])
    stations.under_way[tasks.pick[task]] -= 1
    stations.under_way[tasks.drop[task]] -= 1
    stations.booked[cars.station[car]] -= cars.booked[car]
    cars.task[car] = cars.station[car] = NONE
    cars.held[car] = cars.booked[car] = False


@inlined
def _chance(dice: int, now: int, car: int, kind: int) -> float:  # pragma: no cover - compiled
    """A number from 0 to below 1 that depends on these alone.

    Source: SplitMix64; Steele, Lea, Flood, "Fast splittable pseudorandom number generators", OOPSLA 2014.
    """
    own = np.uint64((now << 16) + (car << 2) + kind)
    mixed = _mixed(_mixed(np.uint64(dice)) + own)
    return np.float64(mixed >> np.uint64(11)) * 2.0**-53


@inlined
def _mixed(bits: Any) -> Any:  # pragma: no cover - compiled
    bits += np.uint64(0x9E3779B97F4A7C15)
    bits = (bits ^ (bits >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    bits = (bits ^ (bits >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return bits ^ (bits >> np.uint64(31))


@inlined
def _emptiest(cars: CarTable) -> int:  # pragma: no cover - compiled
    """The car that comes next to choose a charger: who has too little for a task first, then by charge."""
    found, least = NONE, 1.0
    for car in range(len(cars.state)):
        if cars.charger[car] != NONE or cars.phase[car] not in (FREE, CHARGING):
            continue
        # Less than that of any car that could be given a task.
        charge = cars.charge[car] - (1.0 if cars.phase[car] == CHARGING else 0.0)
        if charge < least:
            found, least = car, charge
    return found


@inlined
def _nearest_charger(floor: Floor, cars: CarTable, state: int) -> int:  # pragma: no cover - compiled
    nearest, least = NONE, NEVER
    for charger in range(len(floor.charger_state)):
        is_taken = False
        for car in range(len(cars.state)):
            is_taken = is_taken or cars.charger[car] == charger
        distance = int(floor.distance[floor.charger_row[charger], state])
        if not is_taken and distance < least:
            nearest, least = charger, distance
    return nearest


@inlined
def _cleared(cars: CarTable) -> int:  # pragma: no cover - compiled
    """The charger of the fullest car that could be given a task, which leaves it; `NONE` if there is no such car."""
    fullest, most = NONE, -1.0
    for car in range(len(cars.state)):
        if cars.charger[car] != NONE and cars.phase[car] == FREE and cars.charge[car] > most:
            fullest, most = car, cars.charge[car]
    if fullest == NONE:
        return NONE
    charger = cars.charger[fullest]
    cars.charger[fullest] = NONE
    return int(charger)


@inlined
def _nearest_spot(floor: Floor, spot_user: Ints, state: int) -> int:  # pragma: no cover - compiled
    nearest, least = NONE, NEVER
    for spot in range(len(spot_user)):
        if spot_user[spot] == NONE:
            distance = floor.distance[floor.spot_row[spot], state]
            if distance < least:
                nearest, least = spot, int(distance)
    return nearest
