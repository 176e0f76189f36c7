"""Exchange: two Kukas that bring parcels to one tray, planned together and played in the physics engine."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import numpy.typing as npt

from fleet.config import ArmConfig
from fleet.robots.arms import ARMS
from fleet.robots.tools import TOOLS
from fleet.stations.arms.arm_spheres import arm_spheres
from fleet.tabletop.errors import TabletopError
from fleet.world.bullet.bench.table import TICK_S, TableWorld
from fleet.world.scene import StaticBox
from fleet.world.tabletop import TableScene
from planners.motion.arm.ik import SrsGeometry
from planners.motion.arm.kinematics import flange_from_tip, pointing_down
from planners.motion.collision.collision import CollisionChecker
from planners.motion.collision.obstacles import Boxes
from planners.motion.search.rrt_connect_native import RrtConnectNative
from planners.motion.two_arms.swept import ArmInWorld
from planners.motion.two_arms.together import Together, Trip, alone_s, plan_together

FloatArray = npt.NDArray[np.float64]

BASE_Y_M = 0.55
"""The arms look the same way, this far to either side of the tray's centre line [m]."""
TRAY_X_M = 0.45
"""The tray is so far ahead of both, so that each reaches all of it [m]."""
DWELL_S = 0.4
"""Rest over the tray and over the table, for the grip [s]."""
MOST_DELIVERIES = 3
_MARGIN_M = 0.02
_FEET_FRAME = 3
"""Links below this stand on the floor."""
_SETTLE_S = 0.5


class SharedTray:
    """Two arms with suction cups at their real limits, the tray of a car between them, a table beside each.

    The tray has room for one arm at a time: one has to leave it before the other comes.
    """

    def __init__(self) -> None:
        self.spec = ARMS.named(ArmConfig().model).spec(TOOLS["suction"])
        self.tool = self.spec.tool
        model = arm_spheres(self.spec)
        self.srs = SrsGeometry.from_joints(self.spec.base_from_joint, self.spec.lower_rad, self.spec.upper_rad)
        self.planner = RrtConnectNative()
        self.bases = [np.array([0.0, side * BASE_Y_M, 0.0]) for side in (-1, 1)]
        floor = Boxes.one((0.0, 0.0, -0.05), (3.0, 3.0, 0.05), min_frame=_FEET_FRAME)
        self.checkers = [
            CollisionChecker(
                model,
                Boxes.join(floor, *(Boxes.one(np.array(box.centre_m) - base, box.half_m) for box in furniture())),
                margin=_MARGIN_M,
            )
            for base in self.bases
        ]
        self.arms = []
        for base in self.bases:
            pose = np.eye(4)
            pose[:3, 3] = base
            self.arms.append(ArmInWorld(model, pose))

    def places(self, rng: np.random.Generator, n_deliveries: int) -> list[list[FloatArray]]:
        """Goal sets of both arms: over its table, over the tray, over its table, ...; each shape (k, 7).

        Raises:
            TabletopError: Not 1 to 3 deliveries.
        """
        if not 1 <= n_deliveries <= MOST_DELIVERIES:
            raise TabletopError(f"--deliveries is {n_deliveries}; valid: an integer from 1 to {MOST_DELIVERIES}")
        return [[self._goals(rng, arm, over_tray=k % 2 == 1) for k in range(2 * n_deliveries + 1)] for arm in range(2)]

    def trips(self, places: Sequence[Sequence[FloatArray]]) -> tuple[Trip, Trip]:
        """What both arms are to do, from `places`."""
        first, second = (self._trip(arm, own) for arm, own in enumerate(places))
        return first, second

    def plan(self, places: Sequence[Sequence[FloatArray]], seed: int) -> Together:
        """Plan both arms' motions and who waits for whom."""
        return plan_together(self.trips(places), self.planner, seed=seed)

    def bounds_s(self, places: Sequence[Sequence[FloatArray]], both: Together, seed: int) -> tuple[float, ...]:
        """How long each arm takes at least when there is no other [s]: its shortest motion that was found."""
        alone = alone_s(self.trips(places), self.planner, seed=seed)
        return tuple(min(own, path.duration_s) for own, path in zip(alone, both.paths, strict=True))

    def scene(self) -> TableScene:
        """The same for the physics engine; nothing lies about."""
        bases = np.array([[*base, 0.0] for base in self.bases])
        floor = StaticBox(kind="table", centre_m=(0.0, 0.0, -0.05), half_m=(1.2, 1.6, 0.05))
        return TableScene(arm=self.spec.name, tool="suction", arm_base=bases, boxes=(floor, *furniture()), objects=())

    def _goals(self, rng: np.random.Generator, arm: int, *, over_tray: bool) -> FloatArray:
        side = (-1, 1)[arm]
        while True:
            y = rng.uniform(-0.15, 0.10) if over_tray else rng.uniform(0.7, 1.0)
            point = np.array([rng.uniform(0.25, 0.5), side * y, rng.uniform(0.30, 0.45)])
            yaw = rng.uniform(-np.pi, np.pi)
            tip = pointing_down(yaw)
            tip[:3, 3] = point - self.bases[arm]
            q = self.srs.ik_all(flange_from_tip(tip, self.tool.length_m))
            q = q[self.checkers[arm].batch(q)] if len(q) else q
            if len(q):
                return q

    def _trip(self, arm: int, places: Sequence[FloatArray]) -> Trip:
        spec = self.spec
        return Trip(
            arm=self.arms[arm],
            checker=self.checkers[arm],
            max_velocity=spec.max_velocity_radps,
            max_acceleration=spec.max_acceleration_radps2,
            start=places[0][np.argmin(np.abs(places[0] - spec.home_rad).max(axis=1))],
            stops=places[1:],
            dwell_s=DWELL_S,
        )


def furniture() -> list[StaticBox]:
    """The car with its tray, and both tables, in the world."""
    x = TRAY_X_M
    solid = [
        ("tray", (x, 0.0, 0.09), (0.22, 0.15, 0.09)),
        ("tray", (x, 0.0, 0.19), (0.17, 0.13, 0.006)),
    ]
    for side in (-1, 1):
        solid.append(("rim", (x + side * 0.17, 0.0, 0.225), (0.005, 0.13, 0.04)))
        solid.append(("rim", (x, side * 0.13, 0.225), (0.17, 0.005, 0.04)))
        solid.append(("table", (x, side * 0.95, 0.12), (0.2, 0.2, 0.12)))
    return [StaticBox(kind=kind, centre_m=centre, half_m=half) for kind, centre, half in solid]


def play(world: TableWorld, both: Together, watch: Callable[[], None]) -> None:
    """Let both arms move as scheduled, and come to rest.

    Args:
        world: The engine, with `SharedTray.scene` and the arms where their motions begin.
        both: A plan with a schedule.
        watch: Called after every tick.
    """
    if both.found is None:
        return
    begin, free = world.ticks, np.zeros(len(both.paths), dtype=np.bool_)
    while (world.ticks - begin) * TICK_S < both.found.makespan_s + _SETTLE_S:
        now, after = ((world.ticks - begin + k) * TICK_S for k in (0, 1))
        q, qd = [], []
        for number, path in enumerate(both.paths):
            done, along = (both.found.along_s(number, time) for time in (now, after))
            angles, speeds = path.state(along)
            q.append(angles)
            qd.append(speeds if along > done else np.zeros_like(speeds))
        world.step(np.array(q), np.array(qd), free)
        watch()
