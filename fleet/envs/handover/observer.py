"""HandoverObserver: what cars and arms see of each other, a row per agent (layout: `fleet.envs.handover.env`)."""

from __future__ import annotations

import numpy as np

from fleet.arrays import BoolArray, FloatArray
from fleet.envs.handover.parcels import Int64Array, ParcelBook, ParcelPlaces
from fleet.envs.handover.rows import (
    N_ARM_NUMBERS,
    N_CAR_NUMBERS,
    ArmsSighted,
    CarsSighted,
    ParcelsSighted,
    arm_rows,
    car_rows,
    find_tips,
)
from fleet.envs.handover.ways import AHEAD_M, LaneWays, find_ways
from fleet.envs.warehouse.control.hands import HandModel
from fleet.envs.warehouse.control.latch import Latches
from fleet.world.protocol import World
from fleet.world.scene import Scene


class HandoverObserver:
    """Looks at an episode.

    Args:
        scene: Robots and fixed things.
        hand: Model of the arms' hands.
        ways: Ways along lanes to the stops of all arms.
        places: Where parcels may lie.
        world: Where everything moves.
    """

    cars: CarsSighted
    """What cars were doing at the last look."""

    def __init__(self, scene: Scene, hand: HandModel, ways: LaneWays, places: ParcelPlaces, world: World) -> None:
        n_cars, n_arms = world.n_cars, world.n_arms
        self._scene = scene
        self._hand = hand
        self._ways = ways
        self._places = places
        self._world = world
        self.car_rows = np.zeros((n_cars, N_CAR_NUMBERS), dtype=np.float32)
        """Observations of cars, shape (n_cars, N_CAR_NUMBERS)."""
        self.arm_rows = np.zeros((n_arms, N_ARM_NUMBERS), dtype=np.float32)
        """Observations of arms, shape (n_arms, N_ARM_NUMBERS)."""
        self.targets = np.zeros((n_arms, 2))
        """What arms are about, see `arm_rows`, shape (n_arms, 2)."""
        self.tips = np.zeros((n_arms, 3))
        """Where the arms' tools are, shape (n_arms, 3)."""
        self._around, self._tool_yaw = np.zeros(n_arms), np.zeros(n_arms)
        self.find_tips()

    def find_tips(self) -> None:
        """Find out where the tools are."""
        q = self._world.arm_positions()
        find_tips(self._hand, self._scene.arm_base, q, self.tips, self._around, self._tool_yaw)

    def nearest_cars(self, within_m: float) -> Int64Array:
        """The car whose tray is nearest to each arm's tool, -1 = none within that distance [m], shape (n_arms,)."""
        poses = self._world.car_poses()
        ahead = self._scene.car.tray_x_m * np.column_stack((np.cos(poses[:, 2]), np.sin(poses[:, 2])))
        gaps = np.linalg.norm(self.tips[:, None, :2] - (poses[:, :2] + ahead), axis=2)
        return np.where(gaps.min(axis=1) <= within_m, gaps.argmin(axis=1), -1)

    def look(
        self,
        book: ParcelBook,
        latches: Latches,
        runs: BoolArray,
        touches: BoolArray,
        car_limits: FloatArray,
        time_left: float,
    ) -> None:
        """Take in this moment, for which the tips have been found: fills the rows.

        Args:
            book: Where parcels are.
            latches: The arms' grips.
            runs: Which motors run, shape (n_cars,).
            touches: Which agents have a new contact, cars first, shape (n_agents,).
            car_limits: Steering [rad] and speed [m/s] at full action, shape (2,).
            time_left: Share of the episode that is left.
        """
        world, places = self._world, self._places
        n_cars, n_arms = world.n_cars, world.n_arms
        ids, poses, sizes, place = book.lie()
        parcels = ParcelsSighted(ids=ids, poses=poses, sizes=sizes, place=place)
        first_tray = len(places.slots)
        car_poses = world.car_poses()
        left, points = np.empty((n_cars, n_arms)), np.empty((n_cars, n_arms, len(AHEAD_M), 2))
        find_ways(self._ways, car_poses, left, points)
        self.cars = CarsSighted(
            poses=car_poses,
            speeds=world.car_speeds(),
            steering=world.car_steering() / car_limits[0],
            loads=np.bincount(place[place >= first_tray] - first_tray, minlength=n_cars + n_arms)[:n_cars],
            runs=runs,
            touches=touches[:n_cars],
            left_m=left,
            points=points,
            stops=self._ways.stops,
            speed_mps=float(car_limits[1]),
        )
        arms = ArmsSighted(
            hand=self._hand,
            base=self._scene.arm_base,
            q=world.arm_positions(),
            held=world.held(),
            closed=latches.closed,
            opening=latches.opening,
            tips=self.tips,
            around=self._around,
            tool_yaw=self._tool_yaw,
            waiting=self._waiting(place),
        )
        car_rows(self.car_rows, self.cars, arms, places, time_left)
        arm_rows(self.arm_rows, self.targets, arms, self.cars, parcels, places, time_left)

    def _waiting(self, place: Int64Array) -> Int64Array:
        """Parcels at pick arms, in their grips too, and free slots of drop arms, shape (n_arms,)."""
        places, n_arms = self._places, self._world.n_arms
        on_slots = place[(place >= 0) & (place < len(places.slots))]
        lie = np.bincount(places.arm_of[on_slots], minlength=n_arms)
        room = np.bincount(places.arm_of, minlength=n_arms)
        return np.where(places.is_drop, room - lie, lie + (self._world.held() >= 0))
