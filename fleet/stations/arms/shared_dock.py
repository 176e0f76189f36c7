"""SharedDock: lets the two arms of one dock move only while they keep clear of each other."""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np

from fleet.arrays import FloatArray
from fleet.stations.arms.arm_cell import FENCE_M
from fleet.stations.arms.arm_controller import ArmController
from fleet.stations.arms.arm_spheres import arm_spheres
from fleet.tasks.order import MAX_EDGE_M
from fleet.world.scene import Scene
from maps.site import Site
from maps.stations import DockPlace
from planners.motion.arm.spheres import box_spheres
from planners.motion.path.timed_path import samples_of
from planners.motion.path.trajectory import Trajectory
from planners.motion.two_arms.diagram import apart_in_step
from planners.motion.two_arms.swept import ArmInWorld, SweptArm, cover

MARGIN_M = 0.02
"""Distance kept between two arms, beyond the spheres that cover them [m]."""
STEP_S = 0.05
"""Step at which motions are compared; at least a tick, so that clocks that differ by one do not matter [s]."""


class SharedDock:
    """Two arms over one tray.

    Each arm keeps to its own side of the tray, but for the motions that lead over it. So these rules suffice, and no
    two arms ever wait for each other:

    * An arm may come to rest over the tray only while it has the tray to itself: the tray is reserved from the start of
      the motion that leads there until the start of the one that leads away.
    * A motion starts only if it stays clear of what the other arm does meanwhile: of the rest of its present motion, in
      step, and then of where that ends. This is the diagonal of the coordination diagram of the two motions.
    * A motion that has begun is ended, also if the parcel is lost on the way: the other arm counts on it. An arm that
      changes its pace makes the other look again, and stop if it has to.

    Args:
        arms: Both arms with nothing in their grips.
        loaded: Both with the largest parcel.
        services: What they do.
        reach_m: Neither arm goes farther than this from its base along the line between the bases [m].
    """

    def __init__(
        self,
        arms: Sequence[ArmInWorld],
        loaded: Sequence[ArmInWorld],
        services: Sequence[ArmController],
        reach_m: float,
    ) -> None:
        self._arms = (arms, loaded)
        self._services = services
        self.holder: int | None = None
        """Which of the two has the tray, None for neither."""
        first, second = (arm.world_from_base[:3, 3] for arm in arms)
        apart_m = float(np.linalg.norm(second - first))
        self._towards = [(second - first) / apart_m, (first - second) / apart_m]
        self._own_m = apart_m - reach_m
        for own, service in enumerate(services):
            service.gate = _Gate(self, own)

    def may_start(self, own: int, motion: Trajectory) -> bool:
        """Whether an arm may start a motion now; then the tray is reserved or given back as the motion needs it."""
        cover_ = self._cover(own, *samples_of(motion, STEP_S, pace=self._services[own].speed))
        if self._is_private(own, cover_, len(cover_) - 1):
            needs_tray = False
            if self.holder != own and all(self._is_private(own, cover_, k) for k in range(len(cover_))):
                return True
        else:
            needs_tray = True
            if self.holder == 1 - own:
                return False
        if not apart_in_step(cover_, self._present(1 - own), MARGIN_M):
            return False
        if needs_tray:
            self.holder = own
        elif self.holder == own:
            self.holder = None
        return True

    def may_go_on(self, own: int) -> bool:
        """Whether what is left of an arm's present motion stays clear of what the other arm does now."""
        return apart_in_step(self._rest_of(own), self._present(1 - own), MARGIN_M)

    def other(self, own: int) -> int:
        """Index in the world of the arm over the same dock."""
        return self._services[1 - own].arm

    def look_again(self, changed: int) -> None:
        """An arm has changed its pace: the other one stops if they would meet, and if need be both."""
        for own in (1 - changed, changed):
            service = self._services[own]
            if service.under_way is not None and not service.paused:
                service.paused = not self.may_go_on(own)

    def _present(self, own: int) -> SweptArm:
        """What is left of an arm's motion; where it rests, if it rests."""
        if self._services[own].paused or self._services[own].under_way is None:
            return self._here(own)
        return self._rest_of(own)

    def _rest_of(self, own: int) -> SweptArm:
        service = self._services[own]
        motion = service.under_way
        if motion is None:
            return self._here(own)
        return self._cover(own, *samples_of(motion, STEP_S, begin_s=service.done_s, pace=service.speed))

    def _here(self, own: int) -> SweptArm:
        q = self._services[own].q[None].copy()
        return self._cover(own, q, np.zeros_like(q))

    def _cover(self, own: int, q: FloatArray, stray: FloatArray) -> SweptArm:
        arm = self._arms[int(self._services[own].carries)][own]
        return cover(arm, q, stray, np.ones(len(q), dtype=np.bool_))

    def _is_private(self, own: int, covered: SweptArm, k: int) -> bool:
        """Whether all of an arm is where the other one never comes."""
        base = self._arms[0][own].world_from_base[:3, 3]
        ahead = (covered.centre[k] - base) @ self._towards[own] + covered.radius[k]
        rows = np.concatenate([np.arange(first, end) for _, first, end in covered.parts])
        return bool(ahead[rows].max() <= self._own_m - MARGIN_M)


def share_docks(site: Site, scene: Scene, services: Sequence[ArmController]) -> tuple[SharedDock, ...]:
    """Coordinate the arms of every dock that has two.

    Args:
        site: Says which stations share a dock.
        scene: Says which arms there are, and where they stand.
        services: What the arms do, in the order of the stations; they are given their gates.
    """
    arms_at: dict[DockPlace, list[int]] = {}
    for arm, place in enumerate(site.stations):
        arms_at.setdefault(place.dock, []).append(arm)
    pairs = sorted(pair for arms in arms_at.values() for pair in itertools.combinations(arms, 2))
    if not pairs:
        return ()
    specs = {spec.name: spec for arm in {arm for pair in pairs for arm in pair} for spec in (scene.arms.specs[arm],)}
    models = {name: arm_spheres(spec) for name, spec in specs.items()}
    centre, radius = box_spheres((MAX_EDGE_M / 2,) * 3)

    def in_world(arm: int, *, loaded: bool) -> ArmInWorld:
        spec = scene.arms.specs[arm]
        below = np.array([0.0, 0.0, spec.tool_length_m + MAX_EDGE_M / 2])
        held = (centre + below, radius) if loaded else None
        return ArmInWorld(models[spec.name], _pose(scene.arm_base[arm]), held)

    return tuple(
        SharedDock(
            [in_world(arm, loaded=False) for arm in pair],
            [in_world(arm, loaded=True) for arm in pair],
            [services[arm] for arm in pair],
            FENCE_M,
        )
        for pair in pairs
    )


def _pose(base: FloatArray) -> FloatArray:
    """A base x, y, z, yaw as a matrix."""
    x, y, z, yaw = base
    pose = np.eye(4)
    pose[:2, :2] = [[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]]
    pose[:3, 3] = x, y, z
    return pose


class _Gate:
    """One arm's view of its dock."""

    def __init__(self, dock: SharedDock, own: int) -> None:
        self._dock = dock
        self._own = own

    def may_start(self, motion: Trajectory) -> bool:
        """See `SharedDock`."""
        return self._dock.may_start(self._own, motion)

    def may_go_on(self) -> bool:
        """See `SharedDock`."""
        return self._dock.may_go_on(self._own)

    @property
    def other(self) -> int:
        """The other arm of the dock."""
        return self._dock.other(self._own)

    def look_again(self) -> None:
        """See `SharedDock`."""
        self._dock.look_again(self._own)
