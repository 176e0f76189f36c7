"""UrdfText: what is wrong with a description, found before the engine reads it: some errors end the whole process."""

from __future__ import annotations

import math
from collections import Counter
from xml.etree import ElementTree

_NUMBERS = {
    "origin": ("xyz", "rpy"),
    "axis": ("xyz",),
    "mass": ("value",),
    "inertia": ("ixx", "ixy", "ixz", "iyy", "iyz", "izz"),
    "box": ("size",),
    "sphere": ("radius",),
    "cylinder": ("radius", "length"),
    "capsule": ("radius", "length"),
    "mesh": ("scale",),
    "limit": ("lower", "upper", "effort", "velocity"),
}
"""Attributes of the parts of links and joints that must be numbers."""
_ROWS = {"xyz": 3, "rpy": 3, "size": 3, "scale": 3}
"""How many numbers such an attribute has; the others have one."""
_SPECK_M = "0.01"
"""Edges of the boxes that stand for what is not seen [m]."""
_FAR = 1e4
"""No joint goes farther [rad or m]."""


def without_visuals(text: str) -> str:
    """Leave out of a description what is only there to be seen; links that touch are seen as small boxes.

    The engine draws a link that has no visuals as what touches, and keeps all of its triangles for that: an arm takes
    4.4 MB with and without visuals, and 1.5 MB so.
    """
    root = ElementTree.fromstring(text)
    for link in root.findall("link"):
        for visual in link.findall("visual"):
            link.remove(visual)
        if link.find("collision") is not None:
            geometry = ElementTree.SubElement(ElementTree.SubElement(link, "visual"), "geometry")
            ElementTree.SubElement(geometry, "box", size=" ".join(3 * [_SPECK_M]))
    return ElementTree.tostring(root, encoding="unicode")


def urdf_fault(text: str) -> str:
    """Say what is wrong with the text of a URDF file; empty if nothing is.

    Links must form one tree, and numbers be finite: the engine takes words for zeros and limits the wrong way round for
    none at all, hands NaN on, and crashes where there are two roots or a link has two parents.
    """
    try:
        root = ElementTree.fromstring(text)
    except (ElementTree.ParseError, LookupError, ValueError) as reason:  # the latter of encodings
        return f"not XML: {reason}"
    links, joints = root.findall("link"), root.findall("joint")
    return _tree_fault(links, joints) or next((fault for part in (*links, *joints) if (fault := _part_fault(part))), "")


def _tree_fault(links: list[ElementTree.Element], joints: list[ElementTree.Element]) -> str:
    """What keeps the links from being one tree."""
    names = Counter(link.get("name", "") for link in links)
    if not names:
        return "no link; valid: a robot with links and joints"
    twice = [name for name, n in names.items() if n > 1 or not name]
    if twice:
        return f"links with the name {twice[0]!r}: {names[twice[0]]}; valid: one, with a name of its own"
    parent_of: dict[str, str] = {}
    for joint in joints:
        ends = []
        for side in ("parent", "child"):
            element = joint.find(side)
            link = "" if element is None else element.get("link", "")
            if link not in names:
                return f"joint {joint.get('name')!r}: {side} {link!r}; valid: a link of the file"
            ends.append(link)
        parent, child = ends
        if child in parent_of:
            return f"link {child!r} hangs on two joints; valid: one"
        parent_of[child] = parent
    roots = [name for name in names if name not in parent_of]
    if len(roots) != 1:
        return f"links without a joint: {', '.join(roots) or 'none'}; valid: one, the base"
    for name in names:
        above, seen = name, set()
        while above in parent_of and above not in seen:
            seen.add(above)
            above = parent_of[above]
        if above in seen:
            return f"link {name!r} hangs on itself; valid: a tree"
    return ""


def _part_fault(part: ElementTree.Element) -> str:
    """What is wrong with the numbers of a link or a joint."""
    where = f"{part.tag} {part.get('name')!r}"
    for element in part.iter():
        for attribute in _NUMBERS.get(element.tag, ()):
            words = element.get(attribute)
            n = _ROWS.get(attribute, 1)
            if words is not None and not _finite(words, n):
                valid = "a finite number" if n == 1 else f"finite numbers, {n} of them"
                return f"{where}: {element.tag} {attribute} {words!r}; valid: {valid}"
    if part.tag == "link":
        masses = [float(mass.get("value", "0")) for mass in part.iter("mass")]
        return f"{where}: mass {masses[0]:g}; valid: a number >= 0 [kg]" if masses and masses[0] < 0 else ""
    if part.get("type") not in ("revolute", "prismatic", "continuous"):
        return ""
    axis = part.find("axis")
    if axis is not None and not any(float(word) for word in axis.get("xyz", "1 0 0").split()):
        return f"{where}: axis {axis.get('xyz')!r}; valid: a direction"
    limit = part.find("limit")
    if limit is None or part.get("type") == "continuous":
        return ""
    ends = [limit.get(side) for side in ("lower", "upper")]
    low, high = (float(end or "0") for end in ends)
    if any(end is not None for end in ends) and not -_FAR <= low <= high <= _FAR:
        return f"{where}: limits {low:g} to {high:g}; valid: lower before upper, at most {_FAR:g} either way"
    if float(limit.get("velocity", "0")) < 0 or float(limit.get("effort", "0")) < 0:
        return f"{where}: velocity {limit.get('velocity')}, effort {limit.get('effort')}; valid: numbers >= 0"
    return ""


def _finite(words: str, n: int) -> bool:
    """Whether a text is so many finite numbers."""
    try:
        numbers = [float(word) for word in words.split()]
        return len(numbers) == n and all(map(math.isfinite, numbers))
    except ValueError:
        return False
