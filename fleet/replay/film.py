"""Film: a part of a run as a moving picture, drawn from where things are; needs no graphics driver."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from fleet.arrays import FloatArray
from fleet.charts.chart import COLORS
from fleet.replay.floor_sheet import ARM, NOSE, FloorSheet
from fleet.robots.cars.models import CarModels
from fleet.robots.twist.pod import POD
from fleet.simulation import Simulation
from planners.motion.arm.kinematics import link_frames

SAMPLE_S = 0.25
"""Between two positions; what is between them is filled in along straight lines [s]."""
PARCEL, PARCEL_M = "#78502a", 0.14
POD_STYLE = 'fill="#b8aea0" fill-opacity="0.5" stroke="#78502a"'
"""Cars below pods are seen."""
AWAY = (-1.0, -1.0)
"""Where a parcel is drawn while it is not on the floor [m]."""


@dataclass(frozen=True, kw_only=True)
class Shots:
    """Where everything was, sample by sample."""

    length_s: float
    """Time that the samples fill [s]."""
    cars: FloatArray
    """x, y, yaw, shape (k, n_cars, 3)."""
    arms: FloatArray
    """x, y of the joints of each arm, from its base to its tip, shape (k, n_arms, n_points, 2)."""
    parcels: Mapping[int, FloatArray]
    """x, y of each parcel, `AWAY` while it is not there, shape (k, 2)."""
    pods: FloatArray
    """x, y, yaw, shape (k, n_pods, 3)."""


def film(
    run: Simulation,
    *,
    begin_s: float,
    length_s: float,
    px_per_m: float,
    told: Callable[[float], None] | None = None,
) -> str:
    """Draw a part of a run as an SVG that moves by itself, again and again.

    Args:
        run: A run that has not begun; it is run up to the end of the film.
        begin_s: Simulated time of the first picture [s].
        length_s: How long the film is [s].
        px_per_m: Pixels of a metre.
        told: Called with the simulated time after each tick [s].

    Raises:
        ConfigError: The arms of the run are of several models.
    """
    shots = _shots(run, begin_s, length_s, told)
    sheet = FloorSheet(run.site, px_per_m=px_per_m)
    sheet.cells()
    sheet.station_names()
    cars = _cars(sheet, run.scene.cars, shots)
    body = [*_arms(sheet, shots), *cars, *_pods(sheet, shots), *_parcels(sheet, shots)]
    return sheet.drawing.svg().removesuffix("</svg>") + "\n".join([*body, "</svg>\n"])


def _shots(run: Simulation, begin_s: float, length_s: float, told: Callable[[float], None] | None) -> Shots:
    def go_on(until_s: float) -> None:
        while run.sim_s < until_s:
            run.tick()
            if told is not None:
                told(run.sim_s)

    go_on(begin_s)
    cars, arms, pods, parcels = [], [], list[FloatArray](), dict[int, list[FloatArray]]()
    n_steps = max(1, round(length_s / SAMPLE_S))
    for sample in range(n_steps + 1):
        go_on(begin_s + sample * SAMPLE_S)
        world = run.world
        cars.append(world.car_poses().copy())
        arms.append(_joints(run))
        pods.append(run.scene.pod_start if world.pods is None else _planar(world.pods.poses()))
        for parcel, pose in zip(world.parcel_ids().tolist(), world.parcel_poses(), strict=True):
            parcels.setdefault(parcel, [np.array(AWAY)] * sample).append(pose[:2].copy())
        for seen in parcels.values():
            seen.extend([np.array(AWAY)] * (sample + 1 - len(seen)))
    return Shots(
        length_s=n_steps * SAMPLE_S,
        cars=np.array(cars),
        arms=np.array(arms),
        parcels={parcel: np.array(seen) for parcel, seen in parcels.items()},
        pods=np.array(pods),
    )


def _planar(poses: FloatArray) -> FloatArray:
    """x, y, yaw of poses x, y, z, qx, qy, qz, qw that are upright, shape (k, 3)."""
    return np.column_stack((poses[:, :2], 2.0 * np.arctan2(poses[:, 5], poses[:, 6])))


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


def _cars(sheet: FloorSheet, models: CarModels, shots: Shots) -> list[str]:
    px = sheet.px_per_m
    drawn = []
    for car in range(shots.cars.shape[1]):
        spec = models[car]
        left, top = -spec.rear_m * px, -spec.half_width_m * px
        long, wide = (spec.rear_m + spec.front_m) * px, 2 * spec.half_width_m * px
        body = f'<rect x="{left:.1f}" y="{top:.1f}" width="{long:.1f}" height="{wide:.1f}"'
        nose = f'<rect x="{spec.front_m * px - 4:.1f}" y="{top:.1f}" width="4" height="{wide:.1f}" fill="{NOSE}"/>'
        shape = f'{body} fill="{COLORS[car % len(COLORS)]}"/>{nose}'
        drawn.append(_moving(sheet, shape, shots.cars[:, car], shots.length_s))
    return drawn


def _pods(sheet: FloorSheet, shots: Shots) -> list[str]:
    """Shelf pods, over the cars that carry them."""
    (half_x, half_y), px = POD.half_m, sheet.px_per_m
    at = f'x="{-half_x * px:.1f}" y="{-half_y * px:.1f}" width="{2 * half_x * px:.1f}" height="{2 * half_y * px:.1f}"'
    shape = f"<rect {at} {POD_STYLE}/>"
    return [_moving(sheet, shape, shots.pods[:, pod], shots.length_s) for pod in range(shots.pods.shape[1])]


def _moving(sheet: FloorSheet, shape: str, poses: FloatArray, length_s: float) -> str:
    """A shape around the origin that goes through poses x, y, yaw, shape (k, 3)."""
    spots = [sheet.spot(x, y) for x, y in poses[:, :2].tolist()]
    drive = _values("transform", [f"{x:.1f} {y:.1f}" for x, y in spots], length_s, kind="translate")
    turns = -np.degrees(np.unwrap(poses[:, 2]))
    turn = _values("transform", [f"{angle:.0f}" for angle in turns], length_s, kind="rotate")
    return f"<g>{drive}<g>{turn}{shape}</g></g>"


def _arms(sheet: FloorSheet, shots: Shots) -> list[str]:
    lines = []
    for arm in range(shots.arms.shape[1]):
        ways = [" ".join("{:.0f},{:.0f}".format(*sheet.spot(x, y)) for x, y in now) for now in shots.arms[:, arm]]
        moves = _values("points", ways, shots.length_s)
        style = f'fill="none" stroke="{ARM}" stroke-width="{0.1 * sheet.px_per_m:.1f}" stroke-linejoin="round"'
        lines.append(f'<polyline points="{ways[0]}" {style} stroke-linecap="round">{moves}</polyline>')
    return lines


def _parcels(sheet: FloorSheet, shots: Shots) -> list[str]:
    boxes = []
    edge = PARCEL_M * sheet.px_per_m
    for seen in shots.parcels.values():
        present = seen[:, 0] > 0
        # Where it is not there it waits, unseen, where it comes or was last: else it would fly in and out.
        shown = np.flatnonzero(present)
        nearest = shown[np.clip(np.searchsorted(shown, np.arange(len(seen)), side="right") - 1, 0, None)]
        spots = [sheet.spot(x, y) for x, y in seen[nearest].tolist()]
        # What is told in steps holds from one sample to the next, what moves needs both ends.
        there = ["1" if here else "0" for here in present[:-1]]
        moves = _values("transform", [f"{x:.1f} {y:.1f}" for x, y in spots], shots.length_s, kind="translate")
        shows = _values("opacity", there, shots.length_s, discrete=True)
        box = f'<rect x="{-edge / 2:.1f}" y="{-edge / 2:.1f}" width="{edge:.1f}" height="{edge:.1f}" fill="{PARCEL}"/>'
        boxes.append(f"<g>{moves}{shows}{box}</g>")
    return boxes


def _values(name: str, values: Sequence[str], length_s: float, *, kind: str = "", discrete: bool = False) -> str:
    """What an attribute is over time."""
    verb = f'animateTransform type="{kind}"' if kind else "animate"
    how = ' calcMode="discrete"' if discrete else ""
    lasts = f'dur="{length_s:g}s" repeatCount="indefinite"'
    return f'<{verb} attributeName="{name}"{how} {lasts} values="{";".join(values)}"/>'
