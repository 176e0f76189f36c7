"""Containment: tasks that nobody will be able to do any more end at once, with the reason, so that others go on."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import numpy.typing as npt

from fleet.dispatch.fitness import Fitness
from fleet.dispatch.situation import CAN_TAKE
from fleet.missions.parcels.inventory import Inventory
from fleet.missions.phases import GONE, CarPhase
from fleet.missions.places import Places
from fleet.missions.pods import Pods
from fleet.missions.state import Missions
from fleet.missions.ways import Ways
from fleet.stations.stations import Stations
from fleet.tasks.board import Task, TaskState

_WAITING = (TaskState.BACKLOG, TaskState.READY)


class Containment:
    """Finds the tasks that what is blocked for good has put out of reach of all cars.

    A task is given up when no car that is left can come to where it begins and on to where it ends. What is blocked
    only for now, or could be driven around backwards, is no reason. A car that is being brought back to its lane may
    come back anywhere, so that nothing is given up because of where it stands.

    Args:
        missions: What cars and tasks are about.
        places: Where visits lead.
        ways: Which places hang together.
        fitness: Which cars can do what.
        inventory: Takes out the parcels of tasks that are given up.
        pods: Tells which pods nobody can fetch any more.
    """

    def __init__(
        self, missions: Missions, places: Places, ways: Ways, fitness: Fitness, inventory: Inventory, pods: Pods
    ) -> None:
        self._missions = missions
        self._stations: Stations = missions.stations
        self._places = places
        self._ways = ways
        self._fitness = fitness
        self._inventory = inventory
        self._pods = pods
        self._seen: tuple[int, ...] = ()

    def tick(self, now_s: float) -> None:
        """End the waiting tasks that cannot be done any more."""
        missions = self._missions
        out = set(missions.cars_in(*GONE))
        # Who leaves for good delivers what it carries, and takes nothing else.
        gone = sorted(car for car in out | missions.leaving.keys() if missions.leaving.get(car, True))
        if not gone and not self._ways.n_cuts and not self._stations.any_lost:
            return
        anywhere = not set(missions.cars_in(CarPhase.RECOVERING)).issubset(gone)
        changes = self._ways.n_cuts, len(gone), self._stations.n_closings, int(anywhere)
        if self._seen == (*changes, missions.board.n_moves):
            return
        left = np.setdiff1d(np.arange(missions.n_cars), gone)
        for task in missions.board.in_state(*_WAITING):
            reason = self._why_never(task, left, gone, anywhere=anywhere)
            if reason:
                self._inventory.withdraw(task, TaskState.FAILED, now_s, reason)
        self._seen = (*changes, missions.board.n_moves)
        missions.changed = True

    def _why_never(self, task: Task, left: npt.NDArray[np.intp], gone: list[int], *, anywhere: bool) -> str:
        """Why none of the cars that are left will ever do a task; empty if one may.

        Args:
            task: A waiting one.
            left: Cars that are left.
            gone: All others.
            anywhere: Whether one of those that are left may come back to the lanes anywhere.
        """
        if not len(left):
            return "no car is left"
        codes = self._fitness.codes(task)
        able = left if codes is None else left[codes[left] == CAN_TAKE]
        if not len(able):
            once = ", ".join(f"car_{car}" for car in gone if self._fitness.fits_any(task, np.array([car])))
            return f"no car that is left can do it: {f'{once} could' if once else 'nobody ever could'}"
        pod_lost = self._pods.why_lost(task)
        if pod_lost:
            return pod_lost
        lost = self._lost(task)
        if lost:
            return f"{lost} is closed for good"
        stops = self._stops(task)
        cut = self._cut(stops)
        if cut is not None:
            return f"no way leads from {cut[0]} to {cut[1]} any more{self._obstacle(*cut[2:])}"
        if anywhere:
            return ""
        tails = self._ways.tails[able]
        first = stops[0]
        for states in first.values():
            for state in states:
                if self._ways.joins(tails, np.full(len(tails), state)).any():
                    return ""
        name, states = next(iter(first.items()))
        return f"no car that is left can come to {name} any more{self._obstacle(int(tails[0]), states[0])}"

    def _picks(self, task: Task) -> tuple[str, ...]:
        """Where its parcel may be picked: where it lies, else wherever it may come from and is not lost."""
        if task.pick_slot is not None:
            return (task.pick,)
        return tuple(name for name in task.delivery.picks if not self._stations.is_lost(self._stations.named(name)))

    def _lost(self, task: Task) -> str:
        """A station that a task cannot do without and that is closed for good; empty if there is none."""
        if task.visit is not None:
            return ""
        picks, drop = self._picks(task), task.delivery.drop
        needed = [drop, *(picks if len(picks) == 1 else ())] if picks else [task.pick]
        lost = (name for name in needed if self._stations.is_lost(self._stations.named(name)))
        return next(lost, "")

    def _stops(self, task: Task) -> list[dict[str, tuple[int, ...]]]:
        """Where a car has to come, one after the other: by name of each place that would do, the states there."""
        if task.visit is not None:
            left = task.visit.errands[task.n_errands_done :]
            return [{name: self._places.named(name).states for name in names} for names in left]
        picks = self._picks(task)
        return [
            {name: (self._stations.named(name).dock_state,) for name in names}
            for names in (picks, (task.delivery.drop,))
        ]

    def _cut(self, stops: list[dict[str, tuple[int, ...]]]) -> tuple[str, str, int, int] | None:
        """Two stops, one after the other, that do not hang together: their names, and a state of each."""
        for here, there in pairwise(stops):
            pairs = [(a, b) for states in here.values() for a in states for others in there.values() for b in others]
            first, second = np.array(pairs).T
            if not self._ways.joins(first, second).any():
                return next(iter(here)), next(iter(there)), *pairs[0]
        return None

    def _obstacle(self, state: int, goal: int) -> str:
        """What stands in the way from a state to a goal, in words."""
        cell = self._ways.in_the_way(state, goal)
        wreck = self._ways.wreck_in(cell) if cell >= 0 else -1
        return f": car_{wreck} stands dead in the way" if wreck >= 0 else ""
