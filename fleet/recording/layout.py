"""Layout: which views a recording opens with, for few robots and for many."""

from __future__ import annotations

import math
from collections.abc import Sequence

import rerun as rr
import rerun.blueprint as rrb

from fleet.recording.frame import FloorPlan
from fleet.recording.scenery import CAMERA, PIXELS_PER_M
from fleet.world.scene import Scene

_LANES_N = 12
"""State lanes that one view shows without scrolling."""


def layout(scene: Scene, floor: FloorPlan, plots: Sequence[str]) -> rrb.Blueprint:
    """Views for a run: scene, top-down plan, state lanes, plots, log.

    Args:
        scene: Gives the extent of the floor and the number of robots.
        floor: Gives the name of the site.
        plots: Titles of the metric plots; their entities are `/metrics/<title>`.
    """
    width, depth = scene.size_m
    window = rrb.TimeAxis(link="LinkToGlobal")
    scene_view = rrb.Spatial3DView(
        origin="/world",
        name=f"Site {floor.name}",
        contents=["$origin/**", f"- /{CAMERA}"],
        line_grid=False,
        eye_controls=rrb.EyeControls3D(
            position=(width / 2, -0.55 * depth - 1.0, 0.75 * max(width * 0.75, depth)),
            look_target=(width / 2, depth * 0.46, 0.0),
            eye_up=(0.0, 0.0, 1.0),
        ),
    )
    top_view = rrb.Spatial2DView(
        origin=f"/{CAMERA}",
        name="From above",
        contents=["/world/**"],
        visual_bounds=rrb.VisualBounds2D(x_range=(0.0, width * PIXELS_PER_M), y_range=(0.0, depth * PIXELS_PER_M)),
    )
    n_cars, n_arms = len(scene.car_start), len(scene.arm_base)
    tasks = rrb.StateTimelineView(origin="/states/tasks", name="Tasks", time_view=window)
    if n_cars + n_arms <= _LANES_N:
        lanes = rrb.StateTimelineView(
            origin="/states", name="Cars and arms", contents=["/states/cars/**", "/states/arms/**"], time_view=window
        )
        states = rrb.Tabs(lanes, tasks)
    else:
        cars = rrb.StateTimelineView(origin="/states/cars", name="Cars", time_view=window)
        arms = rrb.StateTimelineView(origin="/states/arms", name="Arms", time_view=window)
        states = rrb.Tabs(cars, arms, tasks)
    counts = rrb.TimeSeriesView(origin="/counts", name="Tasks by state", axis_x=window)
    metrics = [
        rrb.TimeSeriesView(origin=f"/metrics/{title}", name=title, axis_x=window) for title in plots
    ] or [rrb.TimeSeriesView(origin="/metrics", name="Metrics", axis_x=window)]
    text = rrb.Tabs(
        rrb.TextLogView(origin="/log", name="Log"), rrb.TextDocumentView(origin="/about", name="About")
    )
    share = min(0.62, max(0.5, 0.45 + 0.05 * math.log2(max(1, n_cars))))
    return rrb.Blueprint(
        rrb.Horizontal(
            rrb.Vertical(scene_view, top_view, row_shares=[3, 2]),
            rrb.Vertical(
                states, rrb.Tabs(counts, *metrics), text, row_shares=[share, (1 - share) * 0.55, (1 - share) * 0.45]
            ),
            column_shares=[3, 2],
        ),
        rrb.TopPanel(state="hidden"),
        rrb.BlueprintPanel(state="hidden"),
        rrb.SelectionPanel(state="hidden"),
        rrb.TimePanel(state="collapsed", timeline="sim_time", play_state="paused"),
        auto_views=False,
    )
