"""Descriptions of our own: fills the numbers of a robot into the URDF texts of `fleet.assets`."""

from __future__ import annotations

from collections.abc import Sequence
from importlib.resources import files
from string import Template


def fill(asset: str, **values: object) -> str:
    """Fill in one description.

    Args:
        asset: File name in `fleet.assets` without ``.urdf.in``.
        values: One for each ``$name`` in the file.

    Returns:
        URDF text.

    Raises:
        KeyError: A ``$name`` has no value.
    """
    text = files("fleet.assets").joinpath(f"{asset}.urdf.in").read_text(encoding="utf-8")
    return Template(text).substitute({name: str(value) for name, value in values.items()})


def spaced(numbers: Sequence[float]) -> str:
    """Write numbers the way URDF attributes take vectors."""
    return " ".join(f"{number:g}" for number in numbers)


def box(size: Sequence[float], xyz: Sequence[float]) -> str:
    """A box of a size at a place in its link [m]: what an element of a drawn or a colliding part holds."""
    return f'<origin xyz="{spaced(xyz)}"/><geometry><box size="{spaced(size)}"/></geometry>'


def solid_box(size: Sequence[float], xyz: Sequence[float], material: str) -> str:
    """A box that is drawn and collides."""
    shape = box(size, xyz)
    return f'    <visual>{shape}<material name="{material}"/></visual>\n    <collision>{shape}</collision>'
