"""ArmFile: any fixed-base arm read at run time from URDF, SDF or MJCF, with its collision spheres and its dynamics."""

from __future__ import annotations

import math
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import numpy.typing as npt

from fleet.arrays import FloatArray
from fleet.errors import FleetError
from fleet.robots.angle import rotation
from fleet.world.bullet.engine.client import Client, PhysicsError, quiet
from fleet.world.bullet.engine.urdf_text import urdf_fault
from planners.motion.arm.arm_model import ArmModel, assemble
from planners.motion.arm.inverse import InverseKinematics, inverse_kinematics
from planners.motion.arm.kinematics import jacobian, link_frames
from planners.motion.arm.spheres import box_spheres, fit_spheres_cached, sphere_count

KINDS = (".urdf", ".sdf", ".xml", ".mjcf")
"""Endings of the files that can be read; the last two are MJCF."""

_PROBE_RAD = 0.5
_AXIS_TOLERANCE = 1e-5
_POSE_TOLERANCE = 1e-4
_SNAP = 1e-5
_SNAP_M = 2e-6
_N_CHECKS = 8
_N_SAMPLES = 300
_TOUCHING_SHARE = 0.5
_SKIN_M = 0.001
"""The engine rounds hulls and boxes by this much."""
_BOX_CELLS = 4
"""A box is cut into at most so many cells along an edge."""


class ArmFileError(FleetError):
    """A file does not describe an arm that can be used."""


@dataclass(frozen=True, kw_only=True, eq=False)
class ArmFile:
    """A serial arm of revolute joints.

    The frame of a joint's link has its z axis on the joint's axis. It is the engine's link frame wherever that has; the
    base frame is the engine's.
    """

    path: Path
    joint_names: tuple[str, ...]
    """Joints, base to tip, shape (n,)."""
    model: ArmModel
    """Joint transforms, limits and spheres."""
    max_velocity_radps: FloatArray
    """Of the file, shape (n,); infinite where it says none."""
    max_torque_nm: FloatArray
    """Of the file, shape (n,); infinite where it says none."""
    touching: tuple[tuple[int, int], ...]
    """Pairs of rigid parts that are not tested, because they are neighbours or their hulls touch most of the time."""
    link_from_frame: FloatArray
    """The frames of this object in the engine's link frames; 0 is the base, shape (n+1, 4, 4)."""
    joint_index: tuple[int, ...]
    """The engine's number of each joint, shape (n,)."""
    part_of_link: Mapping[int, int]
    """Rigid part of each link of the engine, -1 being its base."""
    frozen: Mapping[str, float]
    """Other movable joints, such as fingers, and where they are held [rad or m]."""
    body: int
    """Which body of the file the arm is."""

    @cached_property
    def inverse(self) -> InverseKinematics:
        """Inverse kinematics for poses of the last link frame."""
        return inverse_kinematics(self.model.base_from_joint, self.model.lower, self.model.upper)

    def flange(self, q: npt.ArrayLike) -> FloatArray:
        """Pose of the last link frame in the base frame for q (n,) [rad], shape (4, 4)."""
        frames: FloatArray = link_frames(self.model.base_from_joint, q)[-1]
        return frames

    def jacobian(self, q: npt.ArrayLike) -> FloatArray:
        """Velocity of the last link frame per joint velocity for q (n,), base frame: linear, then angular; (6, n)."""
        return jacobian(self.model.base_from_joint, q)


def read_arm(
    path: Path | str,
    *,
    tip: str | None = None,
    frozen: Mapping[str, float] | None = None,
    allowed: Sequence[tuple[str, str]] = (),
    tool_length_m: float = 0.0,
    cache_dir: Path | None = None,
) -> ArmFile:
    """Read an arm and cover it with spheres.

    The arm is the chain of revolute joints from the base to where it branches, or to a named link. Every other movable
    joint stays where it is put, and what hangs on it counts to the link that carries it.

    Args:
        path: A URDF, SDF or MJCF file (.urdf, .sdf, .xml, .mjcf); of several bodies, the one with the most joints.
        tip: Name of the link that ends the chain; None for the last before the arm branches.
        frozen: Where other joints are held, by name [rad or m]; zero unless given, or their nearest limit to it.
        allowed: Pairs of links that may touch, by name: where hulls meet that the links themselves do not.
        tool_length_m: From the last link frame to the tool tip along its +z [m].
        cache_dir: Directory for fitted spheres; None fits anew.

    Returns:
        The arm.

    Raises:
        ArmFileError: No such file, not loadable, no movable joint, a sliding joint in the chain, an unknown name, a
            number out of range.
    """
    if not isinstance(path, str | Path):
        raise ArmFileError(f"path is {path!r}; valid: the path of a {', '.join(KINDS)} file")
    place = Path(path)
    if not isinstance(tool_length_m, int | float) or not math.isfinite(tool_length_m):
        raise ArmFileError(f"tool_length_m is {tool_length_m!r}; valid: a finite number [m]")
    with _Body(place) as body:
        chain = body.chain(tip)
        held = body.freeze(chain, frozen or {})
        base_from_joint, link_from_frame = body.frames(chain)
        lower, upper = body.limits(chain)
        part_of_link = rigid_parts([info[16] for info in body.info], chain)
        covers = body.covers(part_of_link, link_from_frame, chain, cache_dir)
        if not covers:
            raise ArmFileError(f"{place}: the arm has no collision shapes; valid: links with <collision> geometry")
        touching, colliding = body.self_contacts(chain, part_of_link, lower, upper, allowed)
        model = assemble(
            base_from_joint=base_from_joint,
            lower=lower,
            upper=upper,
            covers=covers,
            tool_length=tool_length_m,
            touching=touching,
            colliding=colliding,
            cache_dir=cache_dir,
        )
        body.check(chain, model, link_from_frame)
        infos = [body.info[link] for link in chain]
        return ArmFile(
            path=place,
            joint_names=tuple(info[1].decode() for info in infos),
            model=model,
            max_velocity_radps=np.array([info[11] if info[11] > 0 else np.inf for info in infos]),
            max_torque_nm=np.array([info[10] if info[10] > 0 else np.inf for info in infos]),
            touching=tuple(touching),
            link_from_frame=link_from_frame,
            joint_index=tuple(chain),
            part_of_link=part_of_link,
            frozen=held,
            body=body.number,
        )


def rigid_parts(parents: Sequence[int], chain: Sequence[int]) -> dict[int, int]:
    """Rigid part of each link of an arm.

    Args:
        parents: The link that each link hangs on, -1 being the base.
        chain: Links that the arm's joints move, base to tip, n of them.

    Returns:
        By link, -1 being the base: 0 for what stands still, i for what joint i moves, n+1 for what only hangs on the
        last link of the chain, such as a tool.
    """
    part_of = {-1: 0}
    for link in range(len(parents)):
        moved_by = [chain.index(a) for a in _ancestors(parents, link) if a in chain]
        part_of[link] = 0 if not moved_by else moved_by[-1] + 1
        if part_of[link] == len(chain) and link != chain[-1]:
            part_of[link] += 1
    return part_of


def load(client: Client, path: Path) -> list[int]:
    """Load a description of any kind with its base fixed; gives the bodies' ids.

    Raises:
        ArmFileError: No such file, an unknown kind, or the engine cannot load it.
    """
    if not path.is_file():
        raise ArmFileError(f"{path}: no such file; valid: a {', '.join(KINDS)} file")
    if path.suffix.lower() not in KINDS:
        raise ArmFileError(f"{path}: unknown kind {path.suffix!r}; valid: {', '.join(KINDS)}")
    if path.suffix.lower() == ".urdf":
        fault = urdf_fault(path.read_text(encoding="utf-8", errors="replace"))
        if fault:
            raise ArmFileError(f"{path}: {fault}")
    try:
        with quiet():
            if path.suffix.lower() == ".urdf":
                flags = client.URDF_USE_SELF_COLLISION | client.URDF_USE_INERTIA_FROM_FILE
                return [client.loadURDF(str(path), useFixedBase=True, flags=flags)]
            if path.suffix.lower() == ".sdf":
                return list(client.loadSDF(str(path)))
            client.setAdditionalSearchPath(str(path.parent))
            with tempfile.TemporaryDirectory(prefix="fleet-") as folder:
                copy = Path(folder) / path.name
                copy.write_text(_without_fromto(path), encoding="utf-8")
                return list(client.loadMJCF(str(copy)))
    except client.engine.error as reason:
        raise ArmFileError(f"{path}: the engine cannot load it: {reason}") from reason


def _without_fromto(path: Path) -> str:
    """MJCF whose segments between two points are written as a middle, a turn and a half length.

    The engine ends the whole process when it is asked for the shape of a capsule given by two points.
    """
    try:
        tree = ElementTree.parse(path)
    except (ElementTree.ParseError, LookupError, ValueError) as reason:  # the latter of encodings
        raise ArmFileError(f"{path}: not XML: {reason}") from reason
    for geom in tree.iter("geom"):
        ends = geom.attrib.pop("fromto", None)
        if ends is None:
            continue
        try:
            numbers = np.array([float(x) for x in ends.split()]).reshape(2, 3)
            radius = float(geom.attrib["size"].split()[0])
        except (KeyError, ValueError) as reason:
            raise ArmFileError(f"{path}: fromto {ends!r} needs six numbers and a size") from reason
        way = numbers[1] - numbers[0]
        length = float(np.linalg.norm(way))
        z = way / length if length > 0 else np.array([0.0, 0.0, 1.0])
        # Half way between z and the wanted axis, as a quaternion w, x, y, z.
        quat = np.array([1.0 + z[2], -z[1], z[0], 0.0]) if z[2] > -1.0 + 1e-9 else np.array([0.0, 1.0, 0.0, 0.0])
        quat /= np.linalg.norm(quat)
        geom.set("type", geom.get("type", "capsule"))
        geom.set("pos", " ".join(repr(float(x)) for x in numbers.mean(0)))
        geom.set("quat", " ".join(repr(float(x)) for x in quat))
        geom.set("size", f"{radius!r} {length / 2!r}")
    return ElementTree.tostring(tree.getroot(), encoding="unicode")


class _Body:
    """The arm's body in an engine of its own, and what can be asked of it."""

    def __init__(self, path: Path) -> None:
        self._client = client = Client()
        self._path = path
        try:
            bodies = load(client, path)
            if not bodies:
                raise ArmFileError(f"{path}: no body in it; valid: a file with one arm")
            self.number = int(np.argmax([client.getNumJoints(b) for b in bodies]))
            self.id = bodies[self.number]
        except (ArmFileError, PhysicsError):
            client.close()
            raise
        self.info = [client.getJointInfo(self.id, link) for link in range(client.getNumJoints(self.id))]
        self._movable = [i for i, info in enumerate(self.info) if info[2] in (0, 1)]

    def __enter__(self) -> _Body:
        return self

    def __exit__(self, *_: object) -> None:
        self._client.close()

    def chain(self, tip: str | None) -> list[int]:
        """The engine's numbers of the chain's joints, base to tip."""
        if not self._movable:
            raise ArmFileError(f"{self._path}: no movable joint; valid: an arm with at least one revolute joint")
        if tip is None:
            end = self._before_branch()
        else:
            names = [info[12].decode() for info in self.info]
            if tip not in names:
                raise ArmFileError(f"{self._path}: no link {tip!r}; valid: {', '.join(names)}")
            end = names.index(tip)
        way = [link for link in self._ancestors(end) if link in self._movable]
        sliding = [self.info[link][1].decode() for link in way if self.info[link][2] != 0]
        if sliding:
            raise ArmFileError(f"{self._path}: joint {sliding[0]!r} of the chain slides; valid: revolute joints")
        if not way:
            raise ArmFileError(f"{self._path}: no movable joint before link {tip!r}")
        return way

    def freeze(self, chain: list[int], frozen: Mapping[str, float]) -> dict[str, float]:
        """Put the joints that are not in the chain where they stay."""
        others = {self.info[link][1].decode(): link for link in self._movable if link not in chain}
        for name in frozen:
            if name not in others:
                raise ArmFileError(f"{self._path}: no joint {name!r} beside the arm; valid: {', '.join(others)}")
        held = {}
        for name, link in others.items():
            low, high = self.info[link][8:10]
            value = frozen.get(name, min(max(0.0, low), high) if low < high else 0.0)
            if (
                not isinstance(value, int | float)
                or not math.isfinite(value)
                or (low < high and not low <= value <= high)
            ):
                raise ArmFileError(f"{self._path}: joint {name!r} at {value!r}; valid: {low:g} to {high:g}")
            held[name] = float(value)
            self._client.resetJointState(self.id, link, value)
        return held

    def limits(self, chain: list[int]) -> tuple[FloatArray, FloatArray]:
        """Joint limits [rad]; a joint without limits has one turn."""
        pairs = [
            self.info[link][8:10] if self.info[link][8] < self.info[link][9] else (-np.pi, np.pi) for link in chain
        ]
        return np.array([low for low, _ in pairs]), np.array([high for _, high in pairs])

    def frames(self, chain: list[int]) -> tuple[FloatArray, FloatArray]:
        """Joint transforms (n, 4, 4), and our frames in the engine's link frames (n+1, 4, 4)."""
        client = self._client
        for link in chain:
            client.resetJointState(self.id, link, 0.0)
        link_from_frame = np.tile(np.eye(4), (len(chain) + 1, 1, 1))
        poses = [self.link_pose(-1)]
        for i, link in enumerate(chain):
            before = self.link_pose(link)
            client.resetJointState(self.id, link, _PROBE_RAD)
            turn = np.linalg.inv(before) @ self.link_pose(link)  # in the link's own frame
            client.resetJointState(self.id, link, 0.0)
            axis = np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]])
            axis /= 2.0 * math.sin(_PROBE_RAD)
            if abs(np.linalg.norm(axis) - 1.0) > _AXIS_TOLERANCE:
                raise ArmFileError(f"{self._path}: joint {self.info[link][1].decode()!r} does not turn its link")
            link_from_frame[i + 1, :3, :3] = _z_along(axis / np.linalg.norm(axis))
            # The axis may pass beside the link's origin: its nearest point stays where it is.
            link_from_frame[i + 1, :3, 3] = np.linalg.lstsq(np.eye(3) - turn[:3, :3], turn[:3, 3], rcond=1e-6)[0]
            poses.append(before @ link_from_frame[i + 1])
        steps = [_snapped(np.linalg.inv(a) @ b) for a, b in pairwise(poses)]
        return np.array(steps), link_from_frame

    def covers(
        self, part_of: Mapping[int, int], link_from_frame: FloatArray, chain: list[int], cache_dir: Path | None
    ) -> list[tuple[int, FloatArray, FloatArray]]:
        """Spheres of every collision shape, in the frame of its part."""
        found = []
        carriers = [-1, *chain, chain[-1]]
        for link, part in part_of.items():
            frame = self.link_pose(carriers[part]) @ link_from_frame[min(part, len(chain))]
            frame_from_link = np.linalg.inv(frame) @ self._inertial_pose(link)
            shapes = self._client.getCollisionShapeData(self.id, link)
            for k, shape in enumerate(shapes):
                if shape[2] == self._client.GEOM_MESH:
                    # The engine gives corners in the link's frame: of one shape among several, or of the only one.
                    corners = self._corners(link, k if len(shapes) > 1 else -1)
                    spheres = fit_spheres_cached(corners, sphere_count(corners), 0, cache_dir)
                    frame_from_shape = frame_from_link
                else:
                    spheres = self._primitive(shape)
                    frame_from_shape = frame_from_link @ _pose(shape[5], shape[6])
                if len(spheres[1]):
                    centre = spheres[0] @ frame_from_shape[:3, :3].T + frame_from_shape[:3, 3]
                    found.append((part, centre, spheres[1] + _SKIN_M))
        return found

    def self_contacts(
        self,
        chain: list[int],
        part_of: Mapping[int, int],
        lower: FloatArray,
        upper: FloatArray,
        allowed: Sequence[tuple[str, str]],
    ) -> tuple[list[tuple[int, int]], list[tuple[int, int]]]:
        """Pairs of parts to leave out, and neighbours to test all the same: by hull contacts in random states."""
        client = self._client
        number = {self._client.getBodyInfo(self.id)[0].decode(): -1} | {
            info[12].decode(): link for link, info in enumerate(self.info)
        }
        if any(isinstance(pair, str) or len(pair) != 2 for pair in allowed):
            raise ArmFileError(f"{self._path}: allowed: {allowed!r}; valid: pairs of names")
        unknown = [name for pair in allowed for name in pair if name not in number]
        if unknown:
            raise ArmFileError(f"{self._path}: allowed: no link {unknown[0]!r}; valid: {', '.join(number)}")
        free = {tuple(sorted(part_of[number[name]] for name in pair)) for pair in allowed}
        links = [link for link in part_of if client.getCollisionShapeData(self.id, link)]
        pairs = [(a, b) for a in links for b in links if part_of[a] < part_of[b]]
        hits = dict.fromkeys({(part_of[a], part_of[b]) for a, b in pairs}, 0)
        for q in np.random.default_rng(0).uniform(lower, upper, (_N_SAMPLES, len(chain))):
            for link, angle in zip(chain, q.tolist(), strict=True):
                client.resetJointState(self.id, link, angle)
            touched = {
                (part_of[a], part_of[b])
                for a, b in pairs
                if client.getClosestPoints(self.id, self.id, 0.0, linkIndexA=a, linkIndexB=b)
            }
            for pair in touched:
                hits[pair] += 1
        last = len(chain)
        touching, colliding = [], []
        for (a, b), n in hits.items():
            near = min(b, last) - min(a, last) <= 1
            joined = near and not (b == last + 1 and a == last - 1)  # a tool and the link before its carrier are apart
            if joined or (a, b) in free or n > _TOUCHING_SHARE * _N_SAMPLES:
                touching.append((a, b))
            elif near and n > 0:
                colliding.append((a, b))
        return sorted(touching), sorted(colliding)

    def check(self, chain: list[int], model: ArmModel, link_from_frame: FloatArray) -> None:
        """Compare our forward kinematics with the engine's in random states."""
        base = self.link_pose(-1)
        for q in np.random.default_rng(1).uniform(model.lower, model.upper, (_N_CHECKS, len(chain))):
            for link, angle in zip(chain, q.tolist(), strict=True):
                self._client.resetJointState(self.id, link, angle)
            frames = base @ link_frames(model.base_from_joint, q)
            for i, link in enumerate(chain):
                theirs = self.link_pose(link) @ link_from_frame[i + 1]
                if np.abs(frames[i + 1] - theirs).max() > _POSE_TOLERANCE:
                    name = self.info[link][12].decode()
                    raise ArmFileError(f"{self._path}: link {name!r} does not move as a chain of revolute joints")

    def link_pose(self, link: int) -> FloatArray:
        """World pose of a link's frame, -1 for the base, shape (4, 4)."""
        if link >= 0:
            state = self._client.getLinkState(self.id, link, computeForwardKinematics=1)
            return _pose(state[4], state[5])
        local = self._client.getDynamicsInfo(self.id, -1)
        base = _pose(*self._client.getBasePositionAndOrientation(self.id))
        pose: FloatArray = base @ np.linalg.inv(_pose(local[3], local[4]))
        return pose

    def _inertial_pose(self, link: int) -> FloatArray:
        if link >= 0:
            state = self._client.getLinkState(self.id, link, computeForwardKinematics=1)
            return _pose(state[0], state[1])
        return _pose(*self._client.getBasePositionAndOrientation(self.id))

    def _primitive(self, shape: tuple[Any, ...]) -> tuple[FloatArray, FloatArray]:
        """Spheres around a shape in its own frame."""
        client = self._client
        kind, size = shape[2], shape[3]
        if kind == client.GEOM_SPHERE:
            return np.zeros((1, 3)), np.array([size[0]])
        if kind == client.GEOM_BOX:
            if not min(size) > 0:
                raise ArmFileError(f"{self._path}: a box of size {size}; valid: three numbers > 0 [m]")
            return box_spheres(np.array(size) / 2, _cells(size))
        if kind in (client.GEOM_CYLINDER, client.GEOM_CAPSULE):
            return _rod_spheres(size[0], size[1], ends=kind == client.GEOM_CAPSULE)
        raise ArmFileError(f"{self._path}: a collision shape of kind {kind}; valid: box, sphere, rod or mesh")

    def _corners(self, link: int, index: int) -> FloatArray:
        """Corners of a mesh's hull as the engine has it, in the frame of the link's mass."""
        corners = np.array(self._client.getMeshData(self.id, link, collisionShapeIndex=index)[1], dtype=np.float64)
        if len(corners) == 0:
            raise ArmFileError(f"{self._path}: a mesh of link {link} has no corners")
        return corners

    def _ancestors(self, link: int) -> list[int]:
        """Links from the base to a link, itself included."""
        return _ancestors([info[16] for info in self.info], link)

    def _before_branch(self) -> int:
        """The last movable link that all other movable links behind the first hang on, or that nothing hangs on."""
        end = self._movable[0]
        while True:
            behind = [m for m in self._movable if m != end and end in self._ancestors(m)]
            nearest = [m for m in behind if not any(b in self._ancestors(m) and b != m for b in behind)]
            if len(nearest) != 1 or self.info[nearest[0]][2] != 0:
                return end
            end = nearest[0]


def _ancestors(parents: Sequence[int], link: int) -> list[int]:
    """Links from the base to a link, itself included."""
    way = []
    while link >= 0:
        way.append(link)
        link = parents[link]
    return way[::-1]


def _pose(position: tuple[float, ...], quat_xyzw: tuple[float, ...]) -> FloatArray:
    pose = np.eye(4)
    pose[:3, :3] = rotation(np.asarray(quat_xyzw) / np.linalg.norm(quat_xyzw))
    pose[:3, 3] = position
    return pose


def _cells(size: tuple[float, float, float]) -> tuple[int, int, int]:
    """Cells along each edge of a box that are about as long as its shortest edge."""
    x, y, z = (min(_BOX_CELLS, max(1, round(edge / min(size)))) for edge in size)
    return x, y, z


def _rod_spheres(length: float, radius: float, *, ends: bool) -> tuple[FloatArray, FloatArray]:
    """Spheres around slices of a cylinder along z that are as long as it is thick, and at the ends of a capsule."""
    n = max(1, round(length / (2 * radius)))
    z = length * ((np.arange(n) + 0.5) / n - 0.5)
    size = np.full(n, math.hypot(radius, length / n / 2))
    if ends:
        z, size = np.append(z, [-length / 2, length / 2]), np.append(size, [radius, radius])
    return np.column_stack([np.zeros_like(z), np.zeros_like(z), z]), size


def _snapped(pose: FloatArray) -> FloatArray:
    """A transform without the rounding of engine and file: quarter turns and hundredths of millimetres are exact."""
    near = pose.copy()
    whole = np.round(pose[:3, :3])
    if np.abs(whole - pose[:3, :3]).max() < _SNAP:
        near[:3, :3] = whole
    even = np.round(pose[:3, 3], 5)
    near[:3, 3] = np.where(np.abs(even - pose[:3, 3]) < _SNAP_M, even, pose[:3, 3])
    return near


def _z_along(axis: FloatArray) -> FloatArray:
    """The smallest rotation that turns z onto a unit vector; half a turn about x for -z."""
    if axis[2] < -1.0 + 1e-9:
        return np.diag([1.0, -1.0, -1.0])
    if axis[2] > 1.0 - 1e-9:
        return np.eye(3)
    v = np.array([-axis[1], axis[0], 0.0])  # z x axis
    cross = np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])
    turn: FloatArray = np.eye(3) + cross + cross @ cross / (1.0 + axis[2])
    return turn
