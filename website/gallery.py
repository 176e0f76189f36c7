"""Gallery: short runs as moving pictures, drawn from where robots and parcels are; needs no graphics driver."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import TYPE_CHECKING

import numpy as np

from fleet.arrays import FloatArray
from fleet.charts.chart import COLORS
from fleet.config import Fidelity, RunConfig
from fleet.robots.cars.models import usual_car
from fleet.simulation import Simulation
from planners.motion.arm.kinematics import link_frames
from website.floor_sheet import ARM, NOSE, FloorSheet

if TYPE_CHECKING:
    from website.parts import Place

SAMPLE_S = 0.25
"""Between two positions; what is between them is filled in along straight lines [s]."""
PARCEL, PARCEL_M = "#78502a", 0.14
AWAY = (-1.0, -1.0)
"""Where a parcel is drawn while it is not on the floor [m]."""


@dataclass(frozen=True, kw_only=True)
class Film:
    """A run, and which part of it is shown."""

    title: str
    config: RunConfig
    begin_s: float
    """Simulated time of the first picture [s]."""
    length_s: float
    px_per_m: float


FILMS: Mapping[str, Film] = MappingProxyType(
    {
        "physics": Film(
            title="Two cars and two arms on the site cell, in full physics",
            config=RunConfig(site="cell", robots=2, tasks=4, seed=1),
            begin_s=2.0,
            length_s=30.0,
            px_per_m=62,
        ),
        "fleet": Film(
            title="Eight cars on the site small, without physics",
            config=RunConfig(site="small", robots=8, tasks=20, seed=3, fidelity=Fidelity.KINEMATIC),
            begin_s=10.0,
            length_s=40.0,
            px_per_m=46,
        ),
        "crowd": Film(
            title="Thirty cars on the site dense, without physics",
            config=RunConfig(site="dense", robots=30, tasks=90, seed=0, fidelity=Fidelity.KINEMATIC),
            begin_s=40.0,
            length_s=30.0,
            px_per_m=34,
        ),
        "two_way": Film(
            title="Six cars on the site two_way, whose aisles are driven both ways",
            config=RunConfig(site="two_way", robots=6, tasks=24, seed=2, fidelity=Fidelity.KINEMATIC),
            begin_s=20.0,
            length_s=40.0,
            px_per_m=38,
        ),
    }
)


@dataclass(frozen=True, kw_only=True)
class Shots:
    """Where everything was, sample by sample."""

    cars: FloatArray
    """x, y, yaw, shape (k, n_cars, 3)."""
    arms: FloatArray
    """x, y of the joints of each arm, from its base to its tip, shape (k, n_arms, n_points, 2)."""
    parcels: Mapping[int, FloatArray]
    """x, y of each parcel, `AWAY` while it is not there, shape (k, 2)."""


def film(name: str, place: Place) -> str:
    """A film as it stands in a page; adds its file to the site."""
    path = f"gallery/{name}.svg"
    place.add(path, animated(FILMS[name]))
    return f"![{FILMS[name].title}]({path})"


def animated(made: Film) -> str:
    """A film as an SVG that moves by itself, again and again."""
    with Simulation(made.config) as run:
        shots = _shots(run, made)
        sheet = FloorSheet(run.site, px_per_m=made.px_per_m)
    sheet.cells()
    sheet.station_names()
    body = [*_arms(sheet, shots, made), *_cars(sheet, shots, made), *_parcels(sheet, shots, made)]
    return sheet.drawing.svg().removesuffix("</svg>") + "\n".join([*body, "</svg>\n"])


def _shots(run: Simulation, made: Film) -> Shots:
    while run.sim_s < made.begin_s:
        run.tick()
    cars, arms, parcels = [], [], dict[int, list[FloatArray]]()
    n_samples = round(made.length_s / SAMPLE_S)
    for sample in range(n_samples):
        while run.sim_s < made.begin_s + sample * SAMPLE_S:
            run.tick()
        world = run.world
        cars.append(world.car_poses().copy())
        arms.append(_joints(run))
        for parcel, pose in zip(world.parcel_ids().tolist(), world.parcel_poses(), strict=True):
            parcels.setdefault(parcel, [np.array(AWAY)] * sample).append(pose[:2].copy())
        for seen in parcels.values():
            seen.extend([np.array(AWAY)] * (sample + 1 - len(seen)))
    return Shots(
        cars=np.array(cars),
        arms=np.array(arms),
        parcels={parcel: np.array(seen) for parcel, seen in parcels.items()},
    )


def _joints(run: Simulation) -> FloatArray:
    """Bases, joints and tips of all arms from above, shape (n_arms, n_points, 2)."""
    scene = run.scene
    spec = scene.arms.only("a moving picture")
    frames = link_frames(spec.base_from_joint, run.world.arm_positions())
    tips = frames[:, -1:, :3, 3] + spec.tool_length_m * frames[:, -1:, :3, 2]
    points = np.concatenate((np.zeros_like(tips), frames[:, :, :3, 3], tips), axis=1)[..., :2]
    cos, sin = np.cos(scene.arm_base[:, 3]), np.sin(scene.arm_base[:, 3])
    turned = np.einsum("aij,anj->ani", np.array([[cos, -sin], [sin, cos]]).transpose(2, 0, 1), points)
    return np.asarray(turned + scene.arm_base[:, None, :2])


def _cars(sheet: FloorSheet, shots: Shots, made: Film) -> list[str]:
    spec, px = usual_car(), made.px_per_m
    left, top = -spec.rear_m * px, -spec.half_width_m * px
    long, wide = (spec.rear_m + spec.front_m) * px, 2 * spec.half_width_m * px
    body = f'<rect x="{left:.1f}" y="{top:.1f}" width="{long:.1f}" height="{wide:.1f}"'
    nose = f'<rect x="{spec.front_m * px - 4:.1f}" y="{top:.1f}" width="4" height="{wide:.1f}" fill="{NOSE}"/>'
    made_of = []
    for car in range(shots.cars.shape[1]):
        spots = [sheet.spot(x, y) for x, y in shots.cars[:, car, :2].tolist()]
        turns = -np.degrees(np.unwrap(shots.cars[:, car, 2]))
        drive = _values("transform", [f"{x:.1f} {y:.1f}" for x, y in spots], made, kind="translate")
        turn = _values("transform", [f"{angle:.0f}" for angle in turns], made, kind="rotate")
        shape = f'{body} fill="{COLORS[car % len(COLORS)]}"/>{nose}'
        made_of.append(f"<g>{drive}<g>{turn}{shape}</g></g>")
    return made_of


def _arms(sheet: FloorSheet, shots: Shots, made: Film) -> list[str]:
    lines = []
    for arm in range(shots.arms.shape[1]):
        ways = [" ".join("{:.0f},{:.0f}".format(*sheet.spot(x, y)) for x, y in now) for now in shots.arms[:, arm]]
        moves = _values("points", ways, made)
        style = f'fill="none" stroke="{ARM}" stroke-width="{0.1 * made.px_per_m:.1f}" stroke-linejoin="round"'
        lines.append(f'<polyline points="{ways[0]}" {style} stroke-linecap="round">{moves}</polyline>')
    return lines


def _parcels(sheet: FloorSheet, shots: Shots, made: Film) -> list[str]:
    boxes = []
    edge = PARCEL_M * made.px_per_m
    for seen in shots.parcels.values():
        spots = [sheet.spot(x, y) for x, y in seen.tolist()]
        there = ["1" if x > 0 else "0" for x, _ in seen.tolist()]
        moves = _values("transform", [f"{x:.1f} {y:.1f}" for x, y in spots], made, kind="translate")
        shows = _values("opacity", there, made, discrete=True)
        box = f'<rect x="{-edge / 2:.1f}" y="{-edge / 2:.1f}" width="{edge:.1f}" height="{edge:.1f}" fill="{PARCEL}"/>'
        boxes.append(f"<g>{moves}{shows}{box}</g>")
    return boxes


def _values(name: str, values: Sequence[str], made: Film, *, kind: str = "", discrete: bool = False) -> str:
    """What an attribute is over time."""
    verb = f'animateTransform type="{kind}"' if kind else "animate"
    how = ' calcMode="discrete"' if discrete else ""
    lasts = f'dur="{made.length_s:g}s" repeatCount="indefinite"'
    return f'<{verb} attributeName="{name}"{how} {lasts} values="{";".join(values)}"/>'
