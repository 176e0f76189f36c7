"""ArmDescription: what a URDF file says about the chain of links from an arm's base to its flange."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from fleet.arrays import FloatArray
from fleet.robots.arms.shapes import SolidShape
from fleet.robots.errors import ArmDescriptionError
from fleet.robots.spec import Visual

_GREY = (0.6, 0.6, 0.6, 1.0)


@dataclass(frozen=True, kw_only=True, eq=False)
class ArmDescription:
    """A serial arm of revolute joints, each about the z axis of its own link; link 0 is the base, n the flange."""

    text: str
    """URDF of these links alone, without what hangs on the flange; meshes are named by absolute path."""
    links: tuple[str, ...]
    """Names of links 0 to n."""
    base_from_joint: FloatArray
    """Fixed transform before each joint's rotation about its own z, shape (n, 4, 4)."""
    lower_rad: FloatArray
    upper_rad: FloatArray
    visuals: tuple[Visual, ...]
    """Of links 'link_0' to 'link_n'."""
    solids: tuple[tuple[SolidShape, ...], ...]
    """Collision shapes of links 0 to n."""

    def with_tool(self, tool: str) -> str:
        """The arm's URDF with a tool merged into it.

        A tool that hangs on a constraint instead costs a quarter more per step and slips ten times as much.

        Args:
            tool: URDF text of the tool's links and joints; one of them is fixed to the flange.
        """
        head, closing, _ = self.text.rpartition("</robot>")
        return head + tool + closing + "\n"


def read_description(path: Path, *, flange: str, n_joints: int) -> ArmDescription:
    """Read an arm from a URDF file.

    The base is the link that carries the first joint: where it is fixed to others, these are left out, and so is all
    that hangs on the flange.

    Args:
        path: The file.
        flange: Name of the link that the last joint moves.
        n_joints: Number of joints from the base to the flange.

    Raises:
        ArmDescriptionError: The file cannot be read, or does not have this chain; says what is missing.
    """
    try:
        root = ElementTree.parse(path).getroot()
    except (OSError, ElementTree.ParseError, LookupError, ValueError) as error:
        raise ArmDescriptionError(f"{path}: {error}; valid: a URDF file") from error
    links = {link.get("name", ""): link for link in root.findall("link")}
    if flange not in links:
        raise ArmDescriptionError(f"{path}: no link {flange!r}; valid: {', '.join(links)}")
    joints = _chain(path, root, flange)
    if len(joints) != n_joints:
        there = ", ".join(joint.get("name", "") for joint in joints) or "none"
        raise ArmDescriptionError(
            f"{path}: {len(joints)} revolute joints up to link {flange!r} ({there}); valid: {n_joints}"
        )
    names = tuple(_end(path, joint, side) for joint, side in [(joints[0], "parent"), *((j, "child") for j in joints)])
    missing = [name for name in names if name not in links]
    if missing:
        raise ArmDescriptionError(f"{path}: a joint names the link {missing[0]!r}; valid: {', '.join(links)}")
    if len(set(names)) < len(names):
        raise ArmDescriptionError(f"{path}: link {flange!r} hangs on itself ({', '.join(names)}); valid: a tree")
    chain = [links[name] for name in names]
    limits = np.array([_limits(path, joint) for joint in joints])
    solids = tuple(tuple(_solids(path, link)) for link in chain)
    bare = [name for name, shapes in zip(names, solids, strict=True) if not shapes]
    if bare:
        raise ArmDescriptionError(
            f"{path}: link {bare[0]!r} has no collision shape; valid: a mesh, box, cylinder, sphere"
        )
    colours = dict(_colours(path, root))
    visuals = [v for k, link in enumerate(chain) for v in _visuals(path, link, f"link_{k}", colours)]
    return ArmDescription(
        text=_text(path, root, chain, joints),
        links=names,
        base_from_joint=np.array([_origin(path, joint.find("origin")) for joint in joints]),
        lower_rad=limits[:, 0],
        upper_rad=limits[:, 1],
        visuals=tuple(visuals),
        solids=solids,
    )


def _chain(path: Path, root: ElementTree.Element, flange: str) -> list[ElementTree.Element]:
    """The revolute joints from the base to the flange, in this order."""
    above = {_end(path, joint, "child"): joint for joint in root.findall("joint")}
    joints: list[ElementTree.Element] = []
    link = flange
    while link in above:
        joint = above.pop(link)  # so that a chain that bites its own tail ends
        fixed = joint.get("type") == "fixed"
        if fixed and joints and not _turns_above(path, above, joint):
            break  # what the base is fixed to
        axis = joint.find("axis")
        if joint.get("type") != "revolute" or axis is None or _numbers(path, axis, "xyz", 3) != [0.0, 0.0, 1.0]:
            raise ArmDescriptionError(
                f"{path}: joint {joint.get('name')!r} on the way to link {flange!r} is {joint.get('type')} about "
                f"{'x' if axis is None else axis.get('xyz')}; valid: revolute about '0 0 1', and fixed ones only "
                "between the file's first link and the base"
            )
        joints.insert(0, joint)
        link = _end(path, joint, "parent")
    return joints


def _turns_above(path: Path, above: dict[str, ElementTree.Element], joint: ElementTree.Element) -> bool:
    """Whether a joint that moves comes before this one."""
    seen: set[str] = set()
    link = _end(path, joint, "parent")
    while link in above and link not in seen:
        seen.add(link)
        if above[link].get("type") != "fixed":
            return True
        link = _end(path, above[link], "parent")
    return False


def _end(path: Path, joint: ElementTree.Element, side: str) -> str:
    element = joint.find(side)
    if element is None or not element.get("link"):
        raise ArmDescriptionError(f"{path}: joint {joint.get('name')!r} has no {side}; valid: the name of a link")
    return element.attrib["link"]


def _limits(path: Path, joint: ElementTree.Element) -> tuple[float, float]:
    limit = joint.find("limit")
    words = (None, None) if limit is None else (limit.get("lower"), limit.get("upper"))
    try:
        lower, upper = (float(word) for word in words if word is not None)
    except ValueError as error:
        raise ArmDescriptionError(
            f"{path}: joint {joint.get('name')!r} has the limits {words[0]} to {words[1]}; valid: two numbers [rad]"
        ) from error
    if not -math.inf < lower < upper < math.inf:
        raise ArmDescriptionError(
            f"{path}: joint {joint.get('name')!r} goes from {lower} to {upper}; valid: finite, lower < upper [rad]"
        )
    return lower, upper


def _numbers(path: Path, element: ElementTree.Element, name: str, n: int, usual: str = "") -> list[float]:
    """The numbers of an attribute."""
    words = element.get(name, usual)
    try:
        numbers = [float(word) for word in words.split()]
    except ValueError:
        numbers = []
    if len(numbers) != n or not all(math.isfinite(number) for number in numbers):
        raise ArmDescriptionError(f"{path}: {element.tag} {name}={words!r}; valid: {n} finite numbers")
    return numbers


def _origin(path: Path, element: ElementTree.Element | None) -> FloatArray:
    """URDF origin (xyz and fixed-axis roll, pitch, yaw) as a 4x4 matrix."""
    pose = np.eye(4)
    if element is None:
        return pose
    roll, pitch, yaw = _numbers(path, element, "rpy", 3, "0 0 0")
    cr, cp, cy = math.cos(roll), math.cos(pitch), math.cos(yaw)
    sr, sp, sy = math.sin(roll), math.sin(pitch), math.sin(yaw)
    pose[:3, :3] = [
        [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
        [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
        [-sp, cp * sr, cp * cr],
    ]
    pose[:3, 3] = _numbers(path, element, "xyz", 3, "0 0 0")
    return pose


def _solids(path: Path, link: ElementTree.Element) -> Iterator[SolidShape]:
    for part in link.findall("collision"):
        geometry = part.find("geometry")
        shape = None if geometry is None else next(iter(geometry), None)
        if shape is None:
            continue
        place = _origin(path, part.find("origin"))
        if shape.tag == "mesh":
            scale = tuple(_numbers(path, shape, "scale", 3, "1 1 1"))
            yield SolidShape(kind="mesh", size_m=scale, mesh=_file(path, shape), link_from_shape=place)
        elif shape.tag == "box":
            size = tuple(_numbers(path, shape, "size", 3))
            yield SolidShape(kind="box", size_m=size, mesh=None, link_from_shape=place)
        elif shape.tag == "cylinder":
            size = (_numbers(path, shape, "radius", 1)[0], _numbers(path, shape, "length", 1)[0])
            yield SolidShape(kind="cylinder", size_m=size, mesh=None, link_from_shape=place)
        elif shape.tag == "sphere":
            size = tuple(_numbers(path, shape, "radius", 1))
            yield SolidShape(kind="sphere", size_m=size, mesh=None, link_from_shape=place)


def _visuals(
    path: Path, link: ElementTree.Element, name: str, colours: dict[str, tuple[float, float, float, float]]
) -> Iterator[Visual]:
    """Drawn meshes and boxes of a link; round shapes are drawn as boxes round them."""
    for part in link.findall("visual"):
        geometry, material = part.find("geometry"), part.find("material")
        shape = None if geometry is None else next(iter(geometry), None)
        if shape is None:
            continue
        size = (0.0, 0.0, 0.0)
        if shape.tag == "box":
            size = tuple(_numbers(path, shape, "size", 3))  # type: ignore[assignment]
        elif shape.tag in ("cylinder", "sphere"):
            width = 2.0 * _numbers(path, shape, "radius", 1)[0]
            size = (width, width, _numbers(path, shape, "length", 1)[0] if shape.tag == "cylinder" else width)
        yield Visual(
            link=name,
            mesh=_file(path, shape) if shape.tag == "mesh" else None,
            size_m=size,
            link_from_visual=_origin(path, part.find("origin")),
            rgba=colours.get("" if material is None else material.get("name", ""), _GREY),
        )


def _colours(path: Path, root: ElementTree.Element) -> Iterator[tuple[str, tuple[float, float, float, float]]]:
    for material in root.iter("material"):
        colour = material.find("color")
        if colour is not None:
            red, green, blue, alpha = _numbers(path, colour, "rgba", 4)
            yield material.get("name", ""), (red, green, blue, alpha)


def _file(path: Path, mesh: ElementTree.Element) -> Path:
    """The file of a mesh: beside the description, or in the package that it is said to be in."""
    name = mesh.get("filename", "")
    inside = name.removeprefix("package://")
    places = [path.parent / inside]
    if inside != name:
        places += [above / Path(*Path(inside).parts[1:]) for above in path.parents if len(Path(inside).parts) > 1]
    for place in places:
        if place.is_file():
            return place
    raise ArmDescriptionError(f"{path}: mesh {name!r} is not there; valid: a file, such as {places[0]}")


def _text(
    path: Path, root: ElementTree.Element, chain: list[ElementTree.Element], joints: list[ElementTree.Element]
) -> str:
    """The description of the chain alone."""
    bare = ElementTree.Element("robot", {"name": root.get("name", "arm")})
    bare.extend(root.findall("material"))
    bare.extend(chain)
    bare.extend(joints)
    for link in chain:
        for mesh in link.iter("mesh"):
            mesh.set("filename", _file(path, mesh).as_posix())
    return ElementTree.tostring(bare, encoding="unicode")
