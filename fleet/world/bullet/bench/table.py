"""TableWorld: the physics engine with a table, arms and things to sort."""

from __future__ import annotations

import os
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from fleet.arrays import BoolArray, FloatArray
from fleet.config import Connect, Grip
from fleet.robots.angle import rotation
from fleet.robots.arms.spec import ArmSpec
from fleet.robots.arms.team import ArmTeam
from fleet.world.bullet.arms import Arms, MotorSteps
from fleet.world.bullet.engine.client import Client, quiet
from fleet.world.bullet.grip import make_grip
from fleet.world.bullet.parcels import Parcels
from fleet.world.protocol import ParcelBody
from fleet.world.tabletop import TableObject, TableScene

SUBSTEP_S = 1.0 / 240.0
N_SUBSTEPS = 4
TICK_S = N_SUBSTEPS * SUBSTEP_S
_N_ITERATIONS = 50
_FRICTION, _SPINNING, _ROLLING = 0.8, 0.05, 0.002
_FINGER_FRICTION = 1.2
_TABLE_FRICTION = 0.8
_CONTACT_BREAKING_M = 0.02
"""The engine's own; anchored friction needs it."""
_COLOURS = {"table": (0.82, 0.80, 0.76, 1.0), "rim": (0.45, 0.47, 0.50, 1.0), "tray": (0.35, 0.42, 0.55, 1.0)}


@dataclass(frozen=True, kw_only=True, eq=False)
class DrawnShape:
    """A shape of a body's link, for a recorder."""

    name: str
    """Unique; the body and link it belongs to."""
    kind: str
    """'box', 'sphere', 'cylinder' or 'mesh'."""
    size_m: tuple[float, float, float]
    """Edges of a box; radius of a sphere first; length and radius of a cylinder first; scale of a mesh."""
    mesh: str
    """File of a mesh."""
    rgba: tuple[float, float, float, float]
    body: int
    link: int
    pose: FloatArray
    """In the frame that `TableWorld.drawn_poses` gives for its link, x, y, z, quat_xyzw, shape (7,)."""


class TableObjects(Parcels):
    """The things on the table, numbered from 0; grips know them by their boxes."""

    def __init__(self, client: Client) -> None:
        super().__init__(client)
        self.kinds: list[TableObject] = []

    def put(self, thing: TableObject) -> None:
        """Put a thing into the world."""
        client, number = self._client, len(self.kinds)
        if thing.path is not None:
            with quiet():
                body = client.loadURDF(
                    str(thing.path), thing.pose[:3].tolist(), thing.pose[3:].tolist(), globalScaling=thing.scale
                )
        else:
            shape, drawn = self._shapes(thing)
            body = client.createMultiBody(
                baseMass=thing.mass_kg,
                baseCollisionShapeIndex=shape,
                baseVisualShapeIndex=drawn,
                basePosition=thing.pose[:3].tolist(),
                baseOrientation=thing.pose[3:].tolist(),
            )
        client.changeDynamics(body, -1, lateralFriction=_FRICTION, spinningFriction=_SPINNING, rollingFriction=_ROLLING)
        self.kinds.append(thing)
        self._bodies[number], self.by_body[body] = body, number
        self._numbers = None
        self.shapes[number] = ParcelBody(
            parcel=number, size_m=thing.size_m, mass_kg=thing.mass_kg, pose=thing.pose.copy()
        )

    def pose(self, parcel: int) -> FloatArray:
        """Centre and orientation of a thing's box, shape (7,): a round thing is turned so that a side looks up."""
        pose = super().pose(parcel)
        kind = self.kinds[parcel].name
        if kind == "sphere":
            pose[3:] = 0.0, 0.0, 0.0, 1.0
        elif kind == "cylinder":
            axis = rotation(pose[3:])[:, 2]
            across = np.array([0.0, 0.0, 1.0]) - axis[2] * axis
            size = float(np.linalg.norm(across))
            if size > 0.1:
                x = across / size
                pose[3:] = _quaternion(np.column_stack([x, np.cross(axis, x), axis]))
        return pose

    def _shapes(self, thing: TableObject) -> tuple[int, int]:
        client, size = self._client, thing.size_m
        if thing.name == "sphere":
            geometry: dict[str, object] = {"radius": size[0] / 2}
            kind, drawn = client.GEOM_SPHERE, geometry
        elif thing.name == "cylinder":
            kind = client.GEOM_CYLINDER
            geometry, drawn = {"radius": size[0] / 2, "height": size[2]}, {"radius": size[0] / 2, "length": size[2]}
        else:
            kind = client.GEOM_BOX
            geometry = drawn = {"halfExtents": [edge / 2 for edge in size]}
        return (
            client.createCollisionShape(kind, **geometry),
            client.createVisualShape(kind, rgbaColor=thing.rgba, **drawn),
        )


class TableWorld:
    """A table, its things and its arms; a tick is 1/60 s.

    Args:
        scene: What there is.
        spec: Model of the arms.
        start: Joint positions of the arms [rad], shape (m, n).
        connect: DIRECT, or GUI for a window.

    Raises:
        PhysicsError: The engine cannot be reached, or refuses a description.
    """

    def __init__(self, scene: TableScene, spec: ArmSpec, start: FloatArray, connect: Connect = Connect.DIRECT) -> None:
        self._client = client = Client(connect)
        self.ticks = 0
        tool = spec.tool
        try:
            client.setGravity(0.0, 0.0, -9.81)
            client.setPhysicsEngineParameter(
                fixedTimeStep=SUBSTEP_S, numSolverIterations=_N_ITERATIONS, deterministicOverlappingPairs=1
            )
            with quiet():
                self._fixed = [self._add_box(box.kind, box.centre_m, box.half_m) for box in scene.boxes]
                steps = MotorSteps(n=N_SUBSTEPS, length_s=SUBSTEP_S)
                team = ArmTeam.alike(spec, len(scene.arm_base))
                self._arms = Arms(client, team, scene.arm_base, start, steps)
                self.objects = TableObjects(client)
                for thing in scene.objects:
                    self.objects.put(thing)
            for body, links in zip(self._arms.bodies, self._arms.links, strict=True):
                for name in tool.touch_links:
                    client.changeDynamics(
                        body, links[name], lateralFriction=_FINGER_FRICTION, spinningFriction=_SPINNING
                    )
            self._touched: list[dict[int, set[int]]] = [{} for _ in self._arms.bodies]
            self._grip = make_grip(
                Grip(scene.tool),
                client,
                self._arms,
                self.objects,
                force_n=None,
                touched=self._touched,
            )
        except BaseException:
            client.close()
            raise
        self._feels = Grip(scene.tool) is Grip.FRICTION
        self.robot_contacts = 0
        """Ticks in which two arms touched each other."""

    @property
    def n_arms(self) -> int:
        """Number of arms."""
        return len(self._arms.bodies)

    def step(self, q: FloatArray, qd: FloatArray, grip: BoolArray) -> None:
        """Advance one tick.

        Args:
            q: Joint positions at its end [rad], shape (m, n).
            qd: Joint velocities there [rad/s], shape (m, n).
            grip: Whether each tool should hold, shape (m,).
        """
        self._arms.aim(q, qd)
        self._grip.command(grip)
        self._client.keep_contacts(_CONTACT_BREAKING_M)
        for substep in range(N_SUBSTEPS):
            self._arms.hold(substep)
            self._grip.before_step()
            self._client.stepSimulation()
            self.objects.moved()
            if self._feels:
                self._feel()
            self._grip.after_step()
        bodies = self._arms.bodies
        self._arms.read()
        if any(self._client.getContactPoints(a, b) for i, a in enumerate(bodies) for b in bodies[i + 1 :]):
            self.robot_contacts += 1
        self.ticks += 1

    def arm_positions(self) -> FloatArray:
        """Joint positions [rad], shape (m, n)."""
        return self._arms.q.copy()

    def held(self) -> list[int]:
        """Thing in each tool, -1 for none."""
        return list(self._grip.held)

    def object_poses(self) -> FloatArray:
        """Poses of the things' boxes, x, y, z, quat_xyzw, shape (k, 7)."""
        return self.objects.poses()

    def object_corners(self, number: int) -> FloatArray:
        """Corners of a thing's mesh or box in the world, shape (v, 3) [m]."""
        kind, body = self.objects.kinds[number], self.objects.body(number)
        if kind.path is None:
            # A round thing's box does not roll with it.
            pose = self.objects.pose(number)
            corners = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) * kind.size_m / 2
        else:
            pose = np.concatenate(self._client.getBasePositionAndOrientation(body))
            corners = np.array(self._client.getMeshData(body, -1)[1], dtype=np.float64)
        return corners @ rotation(pose[3:]).T + pose[:3]

    def drawn_shapes(self) -> list[DrawnShape]:
        """Everything there is to draw, in the order of `drawn_poses`."""
        client = self._client
        shapes = []
        groups = [("boxes", self._fixed), ("arms", self._arms.bodies), ("things", self._things())]
        for group, bodies in groups:
            for number, body in enumerate(bodies):
                for count, row in enumerate(client.getVisualShapeData(body)):
                    kind = {2: "sphere", 3: "box", 4: "cylinder"}.get(row[2], "mesh")
                    mesh = row[4].decode()
                    if kind == "mesh" and not os.path.isfile(mesh):
                        continue
                    shapes.append(
                        DrawnShape(
                            name=f"{group}/{number}/{count}",
                            kind=kind,
                            size_m=tuple(row[3]),
                            mesh=mesh,
                            rgba=tuple(row[7]),
                            body=body,
                            link=row[1],
                            pose=np.array([*row[5], *row[6]]),
                        )
                    )
        return shapes

    def drawn_poses(self, shapes: list[DrawnShape]) -> FloatArray:
        """Poses of shapes in the world now, x, y, z, quat_xyzw, shape (k, 7)."""
        client = self._client
        rows = []
        for shape in shapes:
            if shape.link < 0:
                position, quat = client.getBasePositionAndOrientation(shape.body)
                local = client.getDynamicsInfo(shape.body, -1)
                position, quat = client.multiplyTransforms(position, quat, *client.invertTransform(local[3], local[4]))
            else:
                state = client.getLinkState(shape.body, shape.link, computeForwardKinematics=1)
                position, quat = state[4], state[5]
            place, turn = client.multiplyTransforms(position, quat, shape.pose[:3].tolist(), shape.pose[3:].tolist())
            rows.append([*place, *turn])
        return np.array(rows)

    def state_bytes(self) -> bytes:
        """Joint states and motions of the things as float64: equal for equal states."""
        return np.array(self._arms.state() + self.objects.state(), dtype=np.float64).tobytes()

    def close(self) -> None:
        """End the connection; calling twice is harmless."""
        self._client.close()

    def _things(self) -> list[int]:
        return [self.objects.body(number) for number in self.objects.ids()]

    def _feel(self) -> None:
        """Note which things the links of each arm touch."""
        for body, links in zip(self._arms.bodies, self._touched, strict=True):
            links.clear()
            for point in self._client.getContactPoints(body):
                if point[2] in self.objects.by_body and (point[8] < 0.0 or point[9] > 0.0):
                    links.setdefault(point[3], set()).add(self.objects.by_body[point[2]])

    def _add_box(self, kind: str, centre: tuple[float, float, float], half: tuple[float, float, float]) -> int:
        client = self._client
        body = client.createMultiBody(
            baseCollisionShapeIndex=client.createCollisionShape(client.GEOM_BOX, halfExtents=list(half)),
            baseVisualShapeIndex=client.createVisualShape(
                client.GEOM_BOX, halfExtents=list(half), rgbaColor=_COLOURS[kind]
            ),
            basePosition=list(centre),
        )
        client.changeDynamics(body, -1, lateralFriction=_TABLE_FRICTION)
        return int(body)


def _quaternion(turn: FloatArray) -> FloatArray:
    """A rotation matrix as x, y, z, w."""
    quat: FloatArray = Rotation.from_matrix(turn).as_quat()
    return quat
