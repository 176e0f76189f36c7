"""Confirm: PyBullet's own meshes have the last word on a planned arm path, in a client apart from the moving world."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from fleet.arrays import FloatArray, IntArray
from fleet.robots.arms.spec import ArmSpec
from fleet.world.bullet.bench.arm_file import ArmFile, load, rigid_parts
from fleet.world.bullet.engine.client import Client, PhysicsError
from fleet.world.bullet.engine.frames import quaternion
from planners.errors import PlanningError
from planners.motion import checks

# The engine takes at most this many shapes in one body.
_SHAPES_PER_BODY = 16
_REVOLUTE, _PRISMATIC = 0, 1
_CORNERS = 4  # a hull has a volume


@dataclass(frozen=True, kw_only=True)
class Confirmation:
    """Verdict on a path."""

    free: bool
    first_index: int
    """First state of the path that touches something, -1 for none."""
    what: str
    """What touches what there, empty if free."""


class PathConfirmer:
    """Checks joint paths of one arm against obstacles, against the arm itself and with a held thing.

    Everything is in the arm's base frame. Which links may touch follows from how the arm is built: those of one rigid
    part, such as a tool and the link that carries it, those of neighbouring parts, and those that the arm names. A held
    thing may touch the last link and what hangs on it.

    Args:
        client: Engine with the arm, which is moved to the origin; it is closed with this object.
        body: The arm.
        joints: The engine's numbers of its joints, base to tip, shape (n,).
        rest: Where its other joints stand, by number [rad or m].
        touching: Pairs of rigid parts that may touch, lower first: 0 is the base, i moves with joint i, n+1 is a tool.
        link_from_frame: The frame that held things are given in, in the engine's frame of the last link; the same when
            None, shape (4, 4).
        tests_itself: Whether the engine reports touches between the body's own links.
    """

    def __init__(
        self,
        client: Client,
        body: int,
        joints: Sequence[int],
        *,
        rest: Mapping[int, float],
        touching: Iterable[tuple[int, int]] = (),
        link_from_frame: FloatArray | None = None,
        tests_itself: bool = True,
    ) -> None:
        self._client, self._arm, self._joints = client, body, list(joints)
        mass = client.getDynamicsInfo(body, -1)
        client.resetBasePositionAndOrientation(body, mass[3], mass[4])
        infos = [client.getJointInfo(body, link) for link in range(client.getNumJoints(body))]
        self._links = {-1: client.getBodyInfo(body)[0].decode()}
        self._links |= {link: info[12].decode() for link, info in enumerate(infos)}
        for joint, value in rest.items():
            client.resetJointState(body, joint, value)
        self._last = self._joints[-1]
        self._link_from_frame = np.eye(4) if link_from_frame is None else link_from_frame
        self._part = part = rigid_parts([info[16] for info in infos], self._joints)
        n = len(self._joints)
        self._carrier = [link for link in part if part[link] >= n]
        allowed = set(touching) | {(i, i + 1) for i in range(n + 1)}
        self._pairs: list[tuple[int, int]] = []
        for a in part:
            for b in part:
                pair = part[a], part[b]
                if a == b or pair[0] > pair[1]:
                    continue
                if pair[0] == pair[1] or pair in allowed:
                    client.setCollisionFilterPair(body, body, a, b, 0)
                elif not tests_itself:
                    self._pairs.append((a, b))
        self._boxes: list[int] = []
        self._things: list[int] = []
        self._held: int | None = None
        self._neighbour: int | None = None
        self._held_corners: FloatArray = np.empty((0, 3))

    @classmethod
    def of_spec(cls, spec: ArmSpec) -> PathConfirmer:
        """For an arm with its tool; fingers stand open.

        Args:
            spec: Arm model; the engine loads its description.

        Raises:
            PhysicsError: The engine refuses the description, or it has fewer joints than the model.
        """
        client = Client()
        try:
            body = client.load_urdf(spec.description, useFixedBase=True, flags=client.URDF_USE_SELF_COLLISION)
            infos = [client.getJointInfo(body, joint) for joint in range(client.getNumJoints(body))]
            tool = spec.tool
            fingers = [info[0] for info in infos if info[1].decode() in tool.finger_joints]
            movable = [info[0] for info in infos if info[2] in (_REVOLUTE, _PRISMATIC) and info[0] not in fingers]
            if len(movable) < spec.n_joints:
                raise PhysicsError(f"{spec.name}: the description has {len(movable)} joints; valid: {spec.n_joints}")
            rest = dict.fromkeys(fingers, tool.finger_travel_m)
            return cls(client, body, movable[: spec.n_joints], rest=rest, touching=spec.touching)
        except BaseException:
            client.close()
            raise

    @classmethod
    def of_file(cls, arm: ArmFile) -> PathConfirmer:
        """For an arm as it was read from a file.

        Raises:
            ArmFileError: The file is not there any more.
        """
        client = Client()
        try:
            body = load(client, arm.path)[arm.body]
            number = {client.getJointInfo(body, i)[1].decode(): i for i in range(client.getNumJoints(body))}
            return cls(
                client,
                body,
                arm.joint_index,
                rest={number[name]: value for name, value in arm.frozen.items()},
                touching=arm.touching,
                link_from_frame=arm.link_from_frame[-1],
                # The other kinds are loaded without contacts between their own links.
                tests_itself=arm.path.suffix.lower() == ".urdf",
            )
        except BaseException:
            client.close()
            raise

    def set_neighbour(self, spec: ArmSpec, place_m: FloatArray) -> None:
        """Put an arm of the same model beside this one.

        Args:
            spec: The model with its tool.
            place_m: Its base in this arm's base frame, shape (3,).
        """
        client = self._client
        place = checks.vector("set_neighbour: place", place_m, 3)
        self._neighbour = client.load_urdf(spec.description, basePosition=place.tolist(), useFixedBase=True)
        for link in range(client.getNumJoints(self._neighbour)):
            if client.getJointInfo(self._neighbour, link)[1].decode() in spec.tool.finger_joints:
                client.resetJointState(self._neighbour, link, spec.tool.finger_travel_m)

    def set_boxes(
        self,
        centre_m: FloatArray,
        half_m: FloatArray,
        yaw_rad: FloatArray | None = None,
        min_frame: IntArray | None = None,
    ) -> None:
        """Replace the boxes in the arm's way.

        Args:
            centre_m: Centres, shape (n, 3).
            half_m: Half sizes, shape (n, 3).
            yaw_rad: Turns about z, shape (n,); all zero when None.
            min_frame: Parts of the arm below this may touch it, as the base touches the floor, shape (n,); all zero
                when None.

        Raises:
            PlanningError: Malformed input.
        """
        client = self._client
        centre, half = (
            checks.rows(f"set_boxes: {name}", row, 3, least=0) for name, row in (("centre", centre_m), ("half", half_m))
        )
        turns = checks.vector("set_boxes: yaw", np.zeros(len(centre)) if yaw_rad is None else yaw_rad, len(centre))
        lowest = np.zeros(len(centre), dtype=np.int64) if min_frame is None else np.asarray(min_frame)
        if half.shape != centre.shape or lowest.shape != turns.shape or not np.all(half > 0):
            raise PlanningError(
                f"set_boxes: centres {centre.shape}, half sizes {half}, parts {lowest.shape}; valid: as many, > 0"
            )
        for body in self._boxes:
            client.removeBody(body)
        self._boxes = []
        for frame in np.unique(lowest):
            alike = np.flatnonzero(lowest == frame)
            for first in range(0, len(alike), _SHAPES_PER_BODY):
                rows = alike[first : first + _SHAPES_PER_BODY]
                shape = client.createCollisionShapeArray(
                    shapeTypes=[client.GEOM_BOX] * len(rows),
                    halfExtents=half[rows].tolist(),
                    collisionFramePositions=centre[rows].tolist(),
                    collisionFrameOrientations=[quaternion(float(yaw)) for yaw in turns[rows]],
                )
                body = client.createMultiBody(baseCollisionShapeIndex=shape)
                for link, part in self._part.items():
                    if part < frame:
                        client.setCollisionFilterPair(self._arm, body, link, -1, 0)
                self._boxes.append(body)

    def set_things(self, corners_m: Iterable[FloatArray]) -> None:
        """Replace the things in the arm's way, each the hull of its corners (v, 3), v >= 4 [m].

        Raises:
            PlanningError: Malformed input.
        """
        hulls = [checks.rows("set_things: corners", corners, 3, least=_CORNERS) for corners in corners_m]
        for body in self._things:
            self._client.removeBody(body)
        self._things = [self._hull(corners, mass_kg=0.0) for corners in hulls]

    def confirm_beside(self, path: FloatArray, beside: FloatArray) -> Confirmation:
        """Check that this arm does not touch its neighbour in any state; nothing else is looked at.

        Args:
            path: Joint positions [rad], shape (k, n), k >= 1.
            beside: The neighbour's at the same moments [rad], shape (k, n).

        Raises:
            PlanningError: Malformed input, or there is no neighbour.
        """
        client, neighbour = self._client, self._neighbour
        n = len(self._joints)
        own, theirs = checks.rows("confirm_beside: path", path, n), checks.rows("confirm_beside: beside", beside, n)
        if neighbour is None or own.shape != theirs.shape:
            raise PlanningError(
                f"confirm_beside: neighbour {neighbour}, {own.shape} and {theirs.shape}; valid: one, equal shapes"
            )
        zeros = [[0.0]] * n
        for index, states in enumerate(zip(own.tolist(), theirs.tolist(), strict=True)):
            for body, q in zip((self._arm, neighbour), states, strict=True):
                client.resetJointStatesMultiDof(body, self._joints, [[angle] for angle in q], zeros)
            for point in client.getClosestPoints(self._arm, neighbour, 0.0):
                if point[8] < 0.0:
                    what = f"{self._links[point[3]]} - the other arm's {self._links[point[4]]}"
                    return Confirmation(free=False, first_index=index, what=what)
        return Confirmation(free=True, first_index=-1, what="")

    def confirm(self, path: FloatArray, held: FloatArray | None = None, *, allowance_m: float = 0.0) -> Confirmation:
        """Check every state of a path.

        The states are checked as they are; nothing is looked at between them.

        Args:
            path: Joint positions [rad], shape (k, n), k >= 1.
            held: Corners of a thing in the tool, of which the hull counts, in the last link's frame, shape (v, 3) [m];
                None for none.
            allowance_m: Depth of a touch that is let pass, >= 0 [m].

        Returns:
            The verdict with the first state that touches something.

        Raises:
            PlanningError: Malformed input: nothing touches what is no number.
        """
        client = self._client
        states = checks.rows("confirm: path", path, len(self._joints))
        allowance_m = checks.positive("confirm: allowance_m", allowance_m, zero=True)
        self._take(np.empty((0, 3)) if held is None else checks.rows("confirm: held", held, 3, least=_CORNERS))
        zeros = [[0.0]] * len(self._joints)
        for index, q in enumerate(states):
            client.resetJointStatesMultiDof(self._arm, self._joints, [[angle] for angle in q.tolist()], zeros)
            if self._held is not None:
                link = client.getLinkState(self._arm, self._last, computeForwardKinematics=1)
                client.resetBasePositionAndOrientation(self._held, link[4], link[5])
            client.performCollisionDetection()
            points = list(client.getContactPoints(self._arm))
            if self._held is not None:
                points += client.getContactPoints(self._held)
            for a, b in self._pairs:
                points += client.getClosestPoints(self._arm, self._arm, 0.0, linkIndexA=a, linkIndexB=b)
            for point in points:
                if point[8] < -allowance_m and self._neighbour not in point[1:3]:
                    what = f"{self._name(point, 0)} - {self._name(point, 1)}"
                    return Confirmation(free=False, first_index=index, what=what)
        return Confirmation(free=True, first_index=-1, what="")

    def close(self) -> None:
        """End the connection; calling twice is harmless."""
        self._client.close()

    def _take(self, corners: FloatArray) -> None:
        client = self._client
        if np.array_equal(corners, self._held_corners):
            return
        if self._held is not None:
            client.removeBody(self._held)
            self._held = None
        self._held_corners = corners.copy()
        if len(corners):
            # Things without mass do not collide with things without mass.
            turn, shift = self._link_from_frame[:3, :3], self._link_from_frame[:3, 3]
            self._held = self._hull(corners @ turn.T + shift, mass_kg=1.0)
            for link in self._carrier:
                client.setCollisionFilterPair(self._arm, self._held, link, -1, 0)

    def _hull(self, corners: FloatArray, mass_kg: float) -> int:
        client = self._client
        shape = client.createCollisionShape(client.GEOM_MESH, vertices=np.asarray(corners).tolist())
        return int(client.createMultiBody(baseMass=mass_kg, baseCollisionShapeIndex=shape))

    def _name(self, point: tuple[int, ...], side: int) -> str:
        body, link = point[1 + side], point[3 + side]
        if body == self._arm:
            return self._links[link]
        if body == self._held:
            return "held thing"
        return "box" if body in self._boxes else f"thing {self._things.index(body)}"
