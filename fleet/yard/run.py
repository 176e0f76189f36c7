"""YardRun: cars pick up and set down along the walls of a yard, again and again."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from fleet.arrays import FloatArray
from fleet.config import require
from fleet.world.protocol import World
from fleet.yard.driver import YardDriver
from fleet.yard.scene import car_shape, yard_scene
from maps.yard import DROP, PICK, Yard
from planners.open_floor import FloorTraffic, OpenFloorConfig, OpenFloorProblem

TURNING_RADIUS_M = 0.5
"""To plan with: the car can turn tighter, and so has something left to correct with [m]."""
SPEED_MPS, BACKWARDS_MPS = 1.0, 0.5
_MARGIN_RADII = 0.36
"""Kept between bodies as planned, for what cars drive beside their ways: 18 cm."""
_CUSP_STEPS = 2.0
"""About what a car loses by coming to a stop and setting off again [steps]."""
_MOST_POSES = 6000
"""That the search for a way may look at."""
_SERVICE_S = 2.0
_AGAIN_S = 1.0
"""After which a car that found no way, or no spot, asks again."""
_STILL_MPS = 0.02


@dataclass(frozen=True, kw_only=True)
class YardResult:
    """What happened in a run."""

    duration_s: float
    deliveries: int
    plans: int
    refused: int
    """Times at which there was no way to a spot."""
    contacts: int
    """Between cars, and of cars with walls and pillars."""
    min_clearance_m: float
    longest_still_s: float
    """Longest time that a car stood, for whatever reason."""
    most_beside_m: float
    """Furthest that a car was beside its way."""
    most_poses: int
    """Poses that the longest search looked at."""
    plan_s: tuple[float, ...]
    """Computing time of each search [s], if there was a clock."""


class YardRun:
    """One run.

    Args:
        yard: Where.
        n_cars: Number of cars, fewer than spots.
        make_world: Makes the world of a scene.
        seed: Of the choice of spots.
        clock: Tells computing time; None = nobody wants to know.

    Raises:
        ConfigError: There are too few spots.
        OpenFloorError: Cars at neighbouring spots would stand too near to each other or to something.
    """

    def __init__(
        self,
        yard: Yard,
        n_cars: int,
        make_world: Callable[..., World],
        *,
        seed: int = 0,
        clock: Callable[[], float] | None = None,
    ) -> None:
        most = len(yard.spots) - 1
        require(1 <= n_cars <= most, "--cars", n_cars, f"1 to {most}, one fewer than yard {yard.name} has spots")
        self.yard = yard
        self._rng, self._clock = np.random.default_rng(seed), clock
        self._at = self._rng.permutation(len(yard.spots))[:n_cars]
        starts = yard.spots[self._at]
        problem = OpenFloorProblem(
            size_m=yard.size_m,
            car=car_shape(TURNING_RADIUS_M),
            starts=yard.spots,
            goals=yard.spots,
            discs=yard.pillars,
            walled=True,
        )
        config = OpenFloorConfig(
            speed_mps=SPEED_MPS,
            margin_radii=_MARGIN_RADII,
            backwards_cost=SPEED_MPS / BACKWARDS_MPS - 1.0,
            cusp_cost=_CUSP_STEPS,
            most_poses=_MOST_POSES,
        )
        FloorTraffic(problem, config)  # refuses spots that are too near to each other
        self._traffic = FloorTraffic(replace(problem, starts=starts, goals=starts), config)
        self.scene = yard_scene(yard, starts)
        self.world = make_world(self.scene)
        self._driver = YardDriver(self.scene.car, starts, self.world.tick_s, SPEED_MPS, BACKWARDS_MPS)
        self._stop_m = np.zeros(n_cars)
        self._arms = np.empty((0, 0))
        self._ticks = 0
        self._ready = np.full(n_cars, self._in(_SERVICE_S))
        self._arrived = np.ones(n_cars, dtype=np.bool_)
        self._still = np.zeros(n_cars, dtype=np.int64)
        self._longest_still, self._beside = 0, 0.0
        self._deliveries, self._plans, self._refused, self._most_poses = 0, 0, 0, 0
        self._plan_s: list[float] = []

    @property
    def ticks(self) -> int:
        """Control periods so far."""
        return self._ticks

    @property
    def deliveries(self) -> int:
        """Times that a car has set down."""
        return self._deliveries

    @property
    def car_words(self) -> tuple[str, ...]:
        """What each car is about, in the words of the time accounts: driving to set down is driving loaded."""
        slow = np.abs(self.world.car_speeds()) < _STILL_MPS
        loaded = [self.yard.kinds[spot] == DROP for spot in self._at]
        return tuple(
            "served" if arrived else "traffic" if stands else f"driving {'loaded' if carries else 'empty'}"
            for arrived, stands, carries in zip(self._arrived.tolist(), slow.tolist(), loaded, strict=True)
        )

    def ways(self) -> tuple[tuple[FloatArray, ...], tuple[FloatArray, ...]]:
        """See `YardDriver.ahead`."""
        return self._driver.ahead(self._stop_m)

    @property
    def time_s(self) -> float:
        """Simulated time so far [s]."""
        return self._ticks * self.world.tick_s

    def tick(self) -> None:
        """Let a control period pass."""
        poses, speeds = self.world.car_poses(), self.world.car_speeds()
        self._traffic.granted_m(self._driver.driven_m)  # tells who has arrived
        for car in range(len(poses)):
            self._serve(car, poses[car], abs(speeds[car]) < _STILL_MPS)
        self._stop_m = self._traffic.granted_m(self._driver.driven_m)
        commands = self._driver.commands(poses, speeds, self._stop_m)
        self.world.step(commands, self._arms, self._arms, np.empty(0, dtype=np.bool_))
        self._ticks += 1
        self._still = np.where(np.abs(self.world.car_speeds()) < _STILL_MPS, self._still + 1, 0)
        self._longest_still = max(self._longest_still, int(self._still.max()))
        self._beside = max(self._beside, self._driver.beside_m)

    def tick_until_planned(self) -> None:
        """Let time pass until somebody has been sent somewhere."""
        while self._plans == 0:
            self.tick()

    def result(self) -> YardResult:
        """What has happened so far."""
        contacts = self.world.contacts()
        return YardResult(
            duration_s=self.time_s,
            deliveries=self._deliveries,
            plans=self._plans,
            refused=self._refused,
            contacts=contacts.robot + contacts.static,
            min_clearance_m=self.world.min_clearance_m(),
            longest_still_s=self._longest_still * self.world.tick_s,
            most_beside_m=self._beside,
            most_poses=self._most_poses,
            plan_s=tuple(self._plan_s),
        )

    def _serve(self, car: int, pose: FloatArray, stands: bool) -> None:
        """Let a car that has come to its spot pick up or set down, and then go on."""
        if not (stands and self._traffic.arrived(car)):
            return
        if not self._arrived[car]:
            self._arrived[car] = True
            self._ready[car] = self._in(_SERVICE_S)
            self._deliveries += self.yard.kinds[self._at[car]] == DROP
        elif self._ticks >= self._ready[car]:
            self._send(car, pose)

    def _send(self, car: int, pose: FloatArray) -> None:
        """Send a car to a free spot of the other kind, if there is one that it can come to."""
        wanted = self.yard.drops if self.yard.kinds[self._at[car]] == PICK else self.yard.picks
        free = np.setdiff1d(wanted, self._at)
        self._ready[car] = self._in(_AGAIN_S)
        if not len(free):
            return
        spot = int(self._rng.choice(free))
        looked, begin = self._traffic.looked, 0.0 if self._clock is None else self._clock()
        way = self._traffic.send(car, pose, self.yard.spots[spot])
        if self._clock is not None:
            self._plan_s.append(self._clock() - begin)
        self._plans += 1
        self._most_poses = max(self._most_poses, self._traffic.looked - looked)
        if way is None:
            self._refused += 1
            return
        self._driver.take(car, way)
        self._at[car], self._arrived[car] = spot, False

    def _in(self, seconds: float) -> int:
        """The tick at which some time from now has passed."""
        return self._ticks + round(seconds / self.world.tick_s)
