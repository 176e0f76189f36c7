"""CarSearch: the way of one car among others, with all that searches on one floor share."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from planners.errors import PlanningError
from planners.open_floor.arrays import FloatArray, IntArray
from planners.open_floor.kernels.body import CarBody
from planners.open_floor.kernels.floor import distances_to, floor_of
from planners.open_floor.kernels.reeds_shepp import MOST_SEGMENTS, length_table
from planners.open_floor.kernels.search import (
    NO_NODE,
    SearchMemory,
    SearchQuery,
    memory_for,
    rules_of,
    sample,
    search,
    trace,
)
from planners.open_floor.kernels.standing import KeptMargins, are_free
from planners.open_floor.kernels.timetable import cars_in_the_way, empty_timetable, enter, last_touch, leave, longer
from planners.open_floor.problem import OpenFloorProblem

_FIRST_STEPS = 128
"""Steps that a timetable has room for at first; it grows when a way is longer."""


@dataclass(frozen=True, kw_only=True)
class OpenFloorConfig:
    """Settings of the search.

    Raises:
        PlanningError: A setting is out of its range.
    """

    step_radii: float = 0.706
    """Length of a step in turning radii: 40 degrees on the tightest curve, as in the published instances."""
    speed_mps: float = 1.0
    """Of cars that drive."""
    checks: int = 16
    """Poses of a step that are looked at: with a quarter of them cars that pass overlap between two."""
    margin_radii: float = 1.0 / 60.0
    """Kept between cars, and from obstacles, in turning radii: 5 cm with a radius of 3 m."""
    weight: float = 1.5
    """Of what is expected to come against what has been: more finds longer ways sooner."""
    turn_cost: float = 0.05
    """What a step on a curve costs more than a straight one [steps]."""
    backwards_cost: float = 0.5
    """What a step backwards costs more than one forwards [steps]."""
    cusp_cost: float = 0.5
    """Of a change between forwards and backwards [steps]."""
    most_poses: int = 1 << 16
    """Poses that one search may look at."""
    worth: float = 6.0
    """What it costs to touch a car in a step [steps]; as much again for every time that its way was given up before."""
    most_repairs: int = 40
    """Ways that are given up before the planner does, for each car."""

    def __post_init__(self) -> None:
        for name, least in (("checks", 1), ("most_poses", 1), ("most_repairs", 0)):
            if getattr(self, name) < least:
                raise PlanningError(f"open floor: {name} = {getattr(self, name)}; valid: an integer >= {least}")
        for name in ("step_radii", "speed_mps", "weight", "worth"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0):
                raise PlanningError(f"open floor: {name} = {value}; valid: a number > 0")
        for name in ("margin_radii", "turn_cost", "backwards_cost", "cusp_cost"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value >= 0):
                raise PlanningError(f"open floor: {name} = {value}; valid: a number >= 0")


class CarSearch:
    """Ways of cars on one floor, one at a time, and the timetable of those that have one.

    Attributes:
        looked: Poses that all searches have looked at.

    Args:
        problem: Floor and cars.
        body: Of the cars.
        margins: Kept between cars and from obstacles.
        config: Settings.
    """

    def __init__(self, problem: OpenFloorProblem, body: CarBody, margins: KeptMargins, config: OpenFloorConfig) -> None:
        car, self._config, self._body = problem.car, config, body
        step_m = config.step_radii * car.turning_radius_m
        self.step_s = step_m / config.speed_mps
        coarse, fine = (
            rules_of(
                radius_m=car.turning_radius_m,
                step_m=step_m,
                checks=config.checks,
                margin_m=margins.to_cars,
                weight=config.weight,
                turn_cost=config.turn_cost,
                backwards_cost=config.backwards_cost,
                cusp_cost=config.cusp_cost,
                fine=fine,
            )
            for fine in (False, True)
        )
        self._rules, self._fine = coarse, fine
        self._floor = floor_of(problem, body, margins.to_obstacles)
        self._table = empty_timetable(
            problem.n_cars, _FIRST_STEPS, problem.size_m, body, step_m, margins.to_cars, config.checks
        )
        self._memory: SearchMemory | None = None
        self._distances: dict[tuple[float, float], FloatArray] = {}
        self._near, self._hit = np.empty((2, max(problem.n_cars, 1)), dtype=np.int64)
        self.looked = 0

    def distance(self, pose: FloatArray, goal: FloatArray) -> float:
        """Way of a point around the obstacles [m]; infinite if there is none."""
        cell = (int(pose[0] / self._floor.cell), int(pose[1] / self._floor.cell))
        table = self._to(goal)
        return float(table[min(cell[0], table.shape[0] - 1), min(cell[1], table.shape[1] - 1)])

    def find(self, start: FloatArray, goal: FloatArray, worth: FloatArray, most: int) -> tuple[FloatArray | None, bool]:
        """Look for the way of a car that has none.

        Args:
            start: Pose, shape (3,).
            goal: Pose, shape (3,).
            worth: Cost of touching each car in a step, infinite for one that must not be touched, shape (n_cars,).
            most: Poses to look at.

        Returns:
            Legs with duration [steps], length [m] and curvature [1/m], shape (k, 3), which `settle` takes, or None;
            and whether all poses that the car can come to were looked at.
        """
        memory, table = self._room(most), self._table
        cos, sin = math.cos(goal[2]), math.sin(goal[2])
        visit = np.full(len(table.n_samples), -1, dtype=np.int64)
        for other in np.flatnonzero(table.n_samples).tolist():
            visit[other] = last_touch(table, other, goal[0], goal[1], cos, sin, self._body, self._rules.margin)
        query = SearchQuery(
            start=start,
            goal=goal,
            distance=self._to(goal),
            curve=length_table(),
            worth=worth,
            visit=visit,
            quiet_step=int(table.n_samples.max(initial=0)) // self._config.checks + 1,
            most=most,
        )
        for rules in (self._rules, self._fine):
            node, looked, exhausted = search(query, self._floor, table, self._body, rules, memory)
            self.looked += looked
            if node != NO_NODE:
                legs = np.empty((memory.link[node, 0] + MOST_SEGMENTS, 3))
                return legs[: trace(node, rules, memory, legs)], False
            if not exhausted:
                break
        return None, exhausted

    def settle(self, car: int, start: FloatArray, legs: FloatArray) -> IntArray:
        """Give a car a way.

        Returns:
            The cars that it comes too near to, shape (k,).
        """
        enter(self._table, car, len(self.sampled(car, start, legs)))
        n = cars_in_the_way(self._table, car, self._body, self._rules.margin, self._near, self._hit)
        return self._hit[:n].copy()

    def occupy(self, car: int, samples: FloatArray) -> None:
        """Give a car that has none a way of samples x, y, cosine and sine of the yaw, shape (k, 4)."""
        self._reserve(len(samples) // self._config.checks + 2)
        self._table.pose[car, : len(samples)] = samples
        enter(self._table, car, len(samples))

    def sampled(self, car: int, start: FloatArray, legs: FloatArray) -> FloatArray:
        """Samples of a way for a car that has none, x, y, cosine and sine of the yaw, shape (k, 4)."""
        self._reserve(math.ceil(legs[:, 0].sum()) + 2)
        n = sample(start, legs, len(legs), self._config.checks, self._table.pose, car)
        return self._table.pose[car, :n].copy()

    def is_clear(self, car: int, start: FloatArray, way: FloatArray) -> bool:
        """Whether a way comes too near to no obstacle and to nobody who has one; the car has it from now on."""
        met = self.settle(car, start, way)
        x, y, cos, sin = self._table.pose[car, : self._table.n_samples[car]].T
        return not len(met) and are_free(np.column_stack((x, y, np.arctan2(sin, cos))), self._floor, self._body)

    def give_up(self, car: int) -> None:
        """Take a car's way from it, if it has one."""
        if self._table.n_samples[car]:
            leave(self._table, car)

    def _reserve(self, n_steps: int) -> None:
        """Make room for a way of so many steps."""
        if n_steps > self._table.n_steps:
            self._table = longer(self._table, max(n_steps, 2 * self._table.n_steps))

    def _to(self, goal: FloatArray) -> FloatArray:
        place = (float(goal[0]), float(goal[1]))
        if place not in self._distances:
            self._distances[place] = distances_to(goal, self._floor)
        return self._distances[place]

    def _room(self, most: int) -> SearchMemory:
        """SearchMemory for a search of so many poses."""
        if self._memory is None or len(self._memory.end) < most:
            self._memory = memory_for(most, len(self._near), self._fine)
        return self._memory
