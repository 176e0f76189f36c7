"""Descriptions of our own: fills the numbers of a robot into the URDF texts of `fleet.assets`."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
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


def box_inertia(mass_kg: float, size_m: Sequence[float]) -> tuple[float, float, float]:
    """Moments of inertia of a solid box about its middle [kg m^2]."""
    x, y, z = size_m
    return (
        round(mass_kg / 12.0 * (y * y + z * z), 5),
        round(mass_kg / 12.0 * (x * x + z * z), 5),
        round(mass_kg / 12.0 * (x * x + y * y), 5),
    )


def solid_box(size: Sequence[float], xyz: Sequence[float], material: str) -> str:
    """A box that is drawn and collides."""
    shape = box(size, xyz)
    return f'    <visual>{shape}<material name="{material}"/></visual>\n    <collision>{shape}</collision>'


def rollers(
    names: tuple[str, str], *, half_track_m: float, radius_m: float, friction: float, mass_kg: float, inertia: float
) -> str:
    """Spheres on the left and the right of the middle, on which a robot that turns on the spot rolls.

    Args:
        names: Of the left and the right link.
        half_track_m: Distance of each from the middle [m].
        radius_m: Radius [m].
        friction: Coefficient of friction.
        mass_kg: Mass of each [kg].
        inertia: Moment of inertia of each about any axis [kg m^2].
    """
    return "".join(
        fill(
            "husky_roller",
            name=name,
            friction=friction,
            mass=mass_kg,
            inertia=inertia,
            radius=radius_m,
            xyz=spaced((0.0, side * half_track_m, radius_m)),
        )
        for name, side in zip(names, (1.0, -1.0), strict=True)
    )


def supports(places_m: Iterable[Sequence[float]], radius_m: float) -> str:
    """Spheres at some places, on which it leans."""
    return "\n".join(
        f'    <collision><origin xyz="{spaced(place)}"/><geometry><sphere radius="{radius_m}"/></geometry></collision>'
        for place in places_m
    )
