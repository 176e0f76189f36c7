"""AckermannBody: the numbers of a car with front wheels that steer, and what follows: description, boxes, drawing."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from fleet.arrays import FloatArray
from fleet.robots.description import box, fill, spaced
from fleet.robots.model import WheelShape
from fleet.robots.spec import HINGES, WHEELS, CarLimits, CarMotors, CarSpec, DriveKind, Visual, visual
from fleet.robots.tray import TRAY_RGBA, Tray, Triple


@dataclass(frozen=True, kw_only=True)
class AckermannBody:
    """One base with chassis and tray, two wheels at its rear, two that steer at its front."""

    name: str
    wheelbase_m: float
    track_m: float
    wheel_radius_m: float
    wheel_width_m: float
    chassis_size_m: Triple
    """A box that covers chassis, wheels and bumpers [m]."""
    chassis_centre_m: Triple
    """In the car's frame: rear axle, on the floor [m]."""
    tray: Tray
    base_mass_kg: float
    """All but wheels and hinges."""
    base_com_m: Triple
    base_inertia: Triple
    """About x, y, z through the centre of mass [kg m^2]."""
    wheel_mass_kg: float
    wheel_inertia: tuple[float, float]
    """About the axle and across it [kg m^2]."""
    hinge_mass_kg: float
    tyre_friction: float
    """Bullet multiplies the coefficients of the two bodies; the floor has 1."""
    body_friction: float
    drawn: tuple[Visual, ...]
    """What is drawn of chassis and wheels; the tray is drawn as it is built."""

    @property
    def mass_kg(self) -> float:
        """Mass of all of it, rounded to 0.1 kg."""
        return round(self.base_mass_kg + 4 * self.wheel_mass_kg + 2 * self.hinge_mass_kg, 1)

    @property
    def visuals(self) -> tuple[Visual, ...]:
        """All that is drawn."""
        boxes = (self.tray.floor(self.tray.floor_z_m - self.tray.wall_m), *self.tray.plates())
        tray = [visual("tray", size_m=size, xyz=xyz, rgba=TRAY_RGBA) for size, xyz in boxes]
        return (*self.drawn, *tray)

    def spec(self, limits: CarLimits, motors: CarMotors) -> CarSpec:
        """Give the specification of a car with this body."""
        (length, width, _), (ahead, _, _) = self.chassis_size_m, self.chassis_centre_m
        tray = self.tray
        return CarSpec(
            name=self.name,
            drive=DriveKind.ACKERMANN,
            motors=motors,
            mass_kg=self.mass_kg,
            wheelbase_m=self.wheelbase_m,
            track_m=self.track_m,
            wheel_radius_m=self.wheel_radius_m,
            front_m=ahead + length / 2,
            rear_m=length / 2 - ahead,
            half_width_m=width / 2,
            height_m=tray.top_z_m,
            body_boxes=self.boxes(),
            tray_x_m=tray.x_m,
            tray_floor_z_m=tray.floor_z_m,
            tray_size_m=tray.inner_m,
            tray_wall_m=tray.wall_m,
            visuals=self.visuals,
            **vars(limits),
        )

    def boxes(self) -> FloatArray:
        """Give the boxes with which the body collides: chassis, block below the tray, walls of the tray.

        Returns:
            Lowest and highest corners in the car's frame [m], shape (6, 2, 3).
        """
        boxes = np.array(self._solid())
        sizes, centres = boxes[:, 0], boxes[:, 1]
        return np.stack((centres - sizes / 2, centres + sizes / 2), axis=1)

    def urdf(self, wheels: WheelShape = "sphere") -> str:
        """Write the car's description.

        Args:
            wheels: Collision shape of the wheels. A sphere touches the floor in one point and costs less than half of a
                cylinder per physics step at the same tracking error.

        Returns:
            URDF text; meshes are named by absolute path.

        Raises:
            ValueError: Unknown wheel shape.
        """
        if wheels == "sphere":
            geometry = f'<sphere radius="{self.wheel_radius_m}"/>'
        elif wheels == "cylinder":
            geometry = f'<cylinder radius="{self.wheel_radius_m}" length="{self.wheel_width_m}"/>'
        else:
            raise ValueError(f"{self.name} wheel shape is {wheels!r}; valid: 'sphere', 'cylinder'")
        ixx, iyy, izz = self.base_inertia
        base = [part for part in self.visuals if part.link not in WHEELS]
        return fill(
            "ackermann",
            name=self.name,
            com=spaced(self.base_com_m),
            base_mass=self.base_mass_kg,
            ixx=ixx,
            iyy=iyy,
            izz=izz,
            body_friction=self.body_friction,
            visuals="\n".join(_drawn(part) for part in base),
            collisions="\n".join(f"    <collision>{box(size, xyz)}</collision>" for size, xyz in self._solid()),
            wheels="".join(self._wheels(geometry)),
        )

    def _wheels(self, geometry: str) -> list[str]:
        """Descriptions of hinges and wheels, left side first, each hinge before its wheels."""
        parts = []
        for hinge, y in zip(HINGES, (self.track_m / 2, -self.track_m / 2), strict=True):
            side = hinge.partition("_")[0]
            place = (self.wheelbase_m, y, self.wheel_radius_m)
            parts.append(fill("ackermann_hinge", side=side, mass=self.hinge_mass_kg, xyz=spaced(place)))
            mounts = (("rear", "chassis", (0.0, y, self.wheel_radius_m)), ("front", f"{side}_hinge", (0.0, 0.0, 0.0)))
            for axle, parent, xyz in mounts:
                name = f"{axle}_{side}"
                along, across = self.wheel_inertia
                parts.append(
                    fill(
                        "ackermann_wheel",
                        name=name,
                        parent=parent,
                        mass=self.wheel_mass_kg,
                        along=along,
                        across=across,
                        xyz=spaced(xyz),
                        visuals="\n".join(_drawn(part) for part in self.drawn if part.link == name),
                        geometry=geometry,
                        friction=self.tyre_friction,
                    )
                )
        return parts

    def _solid(self) -> list[tuple[Triple, Triple]]:
        """Size and centre of the boxes that collide."""
        return [(self.chassis_size_m, self.chassis_centre_m), self._support(), *self.tray.plates()]

    def _support(self) -> tuple[Triple, Triple]:
        """Size and centre of the block between chassis and tray floor: a floor too thick to be pressed through."""
        return self.tray.floor(self.chassis_centre_m[2] + self.chassis_size_m[2] / 2)


def _drawn(part: Visual) -> str:
    pose = part.link_from_visual
    roll, yaw = math.atan2(pose[2, 1], pose[2, 2]), math.atan2(pose[1, 0], pose[0, 0])
    shape = (
        f'<box size="{spaced(part.size_m)}"/>' if part.mesh is None else f'<mesh filename="{part.mesh.as_posix()}"/>'
    )
    red, green, blue, alpha = part.rgba
    colour = f"{red:g}_{green:g}_{blue:g}_{alpha:g}"
    place = spaced(pose[:3, 3].tolist())
    return (
        f'    <visual><origin rpy="{roll!r} 0 {yaw:g}" xyz="{place}"/><geometry>{shape}</geometry>'
        f'<material name="{colour}"><color rgba="{spaced(part.rgba)}"/></material></visual>'
    )
