"""Layout: which views a recording opens with, for few robots and for many."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from fleet.arrays import FloatArray
from fleet.recording.header import DrawnFloor
from fleet.recording.rerun_stream.bodies import CAR_BODIES
from fleet.recording.rerun_stream.coordination import CONGESTION, PRIORITIES, WAITS
from fleet.recording.rerun_stream.lanes import FEW_ROBOTS, STATES, car_paths
from fleet.recording.rerun_stream.scenery import CAMERA, LABELS, PIXELS_PER_M, RULER
from fleet.recording.rerun_stream.views import EYE, VIEWS, close_up
from fleet.world.scene import Scene

_FLAT = (CAMERA, EYE, f"{VIEWS}/**", f"{CONGESTION}/**")
"""What is not for views in three dimensions."""
_WRITTEN = (LABELS, RULER)
"""Names and numbers, which would hide the robots in a small view and close up."""
CLOSE_UPS = 6
"""So many stations are shown close up, each in a tab: more tabs would leave no room for their names."""
_LANES_PER_TAB = 25
"""State lanes of cars in one tab."""
_LANE_PX = 40.0
"""Height of a state lane with its name."""
_TASKS_SEEN = 6
"""Lanes of tasks for which there is room beside few robots."""
_WINDOW_S = (-15.0, 8.0)
"""Part of the state lanes that is shown, about the time cursor [s]."""
_FIELD_OF_VIEW_RAD = math.radians(55.0)
"""Vertical field of view of the viewer's eye (its default)."""
_ELEVATION_RAD = math.radians(60.0)
"""Steep enough to look over shelves into the aisles behind them."""
_MARGIN_M = 0.6


def layout(
    scene: Scene, floor: DrawnFloor, plots: Sequence[str], cameras: Sequence[str], *, live: bool, internals: bool
) -> rrb.Blueprint:
    """Views for a run: scene, plan from above, one station close up, cameras, state lanes, plots, log.

    Args:
        scene: Gives the extent of the floor and the number of robots.
        floor: Gives the name of the site.
        plots: Titles of the metric plots; their entities are ``/metrics/<title>``.
        cameras: Names of the cameras; their entities are ``/world/cameras/<name>``.
        live: Whether viewers are to follow a run that goes on.
        internals: Whether to show what the planners think.
    """
    few = len(scene.car_start) + len(scene.arm_base) <= FEW_ROBOTS
    # In a small view names would hide the robots.
    names = {} if few else {f"/{CAR_BODIES}": [rr.Mesh3D.from_fields(), rr.Boxes3D.from_fields(show_labels=False)]}
    hidden = _FLAT if few else (*_WRITTEN, *_FLAT)
    site = _eye_view(f"Site {floor.name}", *_overview(scene.size_m, 2.0), hidden=hidden, overrides=names)
    above = _from_above("From above", scene, ["/world/**", f"- /{EYE}", f"- /{VIEWS}/**", f"- /{CONGESTION}/**"])
    congestion = _from_above(
        "Stood: orange traffic, violet station, red blocked",
        scene,
        ["/world/boxes/**", "/world/floor/**", f"/{CONGESTION}/**", f"/{CAMERA}"],
        margin=0.0,
    )
    close: list[rrb.View | rrb.Grid] = []
    if len(scene.arm_base):
        close.append(_at_work(scene))
    for arm, base in enumerate(scene.arm_base[:CLOSE_UPS]):
        name = floor.station_names[arm] if floor.station_names else f"arm_{arm}"
        close.append(_eye_view(name, *close_up(base), hidden=(*_WRITTEN, *_FLAT)))
    if cameras and close:
        close += _camera_views(scene, cameras)
    why = rrb.TextDocumentView(origin=f"/{WAITS}", name="Why robots wait")
    graph = rrb.GraphView(origin=f"/{WAITS}", name="Waits")
    text: list[rrb.View] = [
        rrb.TextLogView(
            origin="/log",
            name="Log",
            # No column of levels: it took a third of the room that sentences need.
            columns=rrb.TextLogColumns(timeline_columns=["sim_time"], text_log_columns=["Body"]),
        ),
        rrb.TextDocumentView(origin="/about", name="About"),
    ]
    plotted = _plots(plots, [rrb.BarChartView(origin=f"/{PRIORITIES}", name="Priorities")] if internals else [])
    if few:
        n_lanes = len(scene.car_start) + len(scene.arm_base)
        views = rrb.Horizontal(
            rrb.Vertical(
                site,
                rrb.Horizontal(
                    rrb.Tabs(above, congestion), rrb.Tabs(*close, graph, active_tab=0), column_shares=[5, 3]
                ),
                row_shares=[4, 3],
            ),
            rrb.Vertical(
                _lanes("Robots", "cars", "arms"),
                _lanes("Tasks", "tasks"),
                why,
                rrb.Horizontal(rrb.Tabs(*plotted), rrb.Tabs(*text), column_shares=[4, 5]),
                row_shares=[(n_lanes + 1.7) * _LANE_PX, (_TASKS_SEEN + 1.7) * _LANE_PX, 68.0, 130.0],
            ),
            column_shares=[3, 2],
        )
    else:
        views = rrb.Horizontal(
            rrb.Vertical(above, rrb.Horizontal(rrb.Tabs(site, *close), congestion), row_shares=[9, 5]),
            rrb.Vertical(
                rrb.Tabs(*_car_lanes(len(scene.car_start)), _lanes("Arms", "arms"), _lanes("Tasks", "tasks")),
                why,
                rrb.Tabs(graph, *plotted, *text, active_tab=0),
                row_shares=[8, 4, 5],
            ),
            column_shares=[9, 5],
        )
    return rrb.Blueprint(
        views,
        rrb.TopPanel(state="hidden"),
        rrb.BlueprintPanel(state="hidden"),
        rrb.SelectionPanel(state="hidden"),
        rrb.TimePanel(state="collapsed", timeline="sim_time", play_state="following" if live else "paused"),
        auto_views=False,
    )


def _from_above(name: str, scene: Scene, contents: list[str], *, margin: float = 1.0) -> rrb.Spatial2DView:
    """The floor as the camera far above sees it, with a margin for names, or without."""
    width, depth = scene.size_m
    aside, below, over = 0.03 * margin * width, 0.05 * margin * depth, 0.07 * margin * depth
    return rrb.Spatial2DView(
        origin=f"/{CAMERA}",
        name=name,
        contents=contents,
        visual_bounds=rrb.VisualBounds2D(
            x_range=(-(aside + _MARGIN_M) * PIXELS_PER_M, (width + aside + _MARGIN_M) * PIXELS_PER_M),
            y_range=(-(below + _MARGIN_M) * PIXELS_PER_M, (depth + over + _MARGIN_M) * PIXELS_PER_M),
        ),
    )


def _car_lanes(n_cars: int) -> list[rrb.StateTimelineView]:
    """State lanes of the cars, as many to a tab as can be seen at once."""
    tabs = []
    for first in range(0, n_cars, _LANES_PER_TAB):
        last = min(first + _LANES_PER_TAB, n_cars) - 1
        name = "Cars" if n_cars <= _LANES_PER_TAB else f"{'' if first else 'Cars '}{first}-{last}"
        tabs.append(_lanes(name, *(f"cars/{path}" for path in car_paths(first, last))))
    return tabs


def _camera_views(scene: Scene, cameras: Sequence[str]) -> list[rrb.View | rrb.Grid]:
    """Colours and depths of all cameras side by side, and all depths as points in the scene."""
    grids = [
        rrb.Grid(
            *(
                rrb.Spatial2DView(origin=f"/{VIEWS}/{camera}", name=f"{camera} {word}", contents=[f"$origin/{word}"])
                for camera in cameras
            ),
            name=title,
        )
        for title, word in (("Cameras", "rgb"), ("Depths", "depth"))
    ]
    eye, target = close_up(scene.arm_base[0])
    cloud = _eye_view("Points seen", eye, target, hidden=(*_WRITTEN, CAMERA, f"{CONGESTION}/**", "world/parcels"))
    return [*grids, cloud]


def _lanes(name: str, *kinds: str) -> rrb.StateTimelineView:
    window = rrb.TimeAxis(
        view_range=rr.TimeRange(
            start=rr.TimeRangeBoundary.cursor_relative(seconds=_WINDOW_S[0]),
            end=rr.TimeRangeBoundary.cursor_relative(seconds=_WINDOW_S[1]),
        )
    )
    contents = [f"$origin/{kind}/**" for kind in kinds]
    return rrb.StateTimelineView(origin=f"/{STATES}", name=name, contents=contents, time_view=window)


def _plots(titles: Sequence[str], more: Sequence[rrb.View]) -> list[rrb.View]:
    origins = {"States": "/counts"} | {title.capitalize(): f"/metrics/{title}" for title in titles}
    if not titles:
        origins["Metrics"] = "/metrics"
    return [
        *(
            rrb.TimeSeriesView(
                origin=origin,
                name=name,
                axis_x=rrb.TimeAxis(link="LinkToGlobal"),
                # The lines of states have the colours of the lanes beside them; names would cover a third of the plot.
                plot_legend=rrb.PlotLegend(corner="LeftTop", visible=name != "States"),
            )
            for name, origin in origins.items()
        ),
        *more,
    ]


def _eye_view(
    name: str,
    eye: FloatArray,
    target: FloatArray,
    *,
    hidden: tuple[str, ...] = _FLAT,
    overrides: Mapping[Any, Any] | None = None,
) -> rrb.Spatial3DView:
    return rrb.Spatial3DView(
        origin="/world",
        name=name,
        contents=["$origin/**", *(f"- /{path}" for path in hidden)],
        line_grid=False,
        overrides=overrides,
        eye_controls=rrb.EyeControls3D(position=eye, look_target=target, eye_up=(0.0, 0.0, 1.0)),
    )


def _at_work(scene: Scene) -> rrb.Spatial3DView:
    """The arm at work, as the eye before it sees it."""
    shown = tuple(path for path in _FLAT if path != EYE)  # the viewer follows what is in the view only
    view = _eye_view("At work", *close_up(scene.arm_base[0]), hidden=(*_WRITTEN, *shown))
    view.properties["EyeControls3D"] = rrb.EyeControls3D(tracking_entity=f"/{EYE}")
    return view


def _overview(size_m: tuple[float, float], aspect: float) -> tuple[FloatArray, FloatArray]:
    """Nearest eye south of the floor that sees all of it in a view of the given aspect, and its target.

    With u and b the offsets of a corner from the centre along the eye's up and backward axes, and t the tangent of half
    the field of view, an eye at (eu, eb) sees it if |u - eu| <= t (eb - b): the two tightest planes meet in the eye.
    """
    centre = np.array([size_m[0] / 2, size_m[1] / 2, 0.0])
    back = np.array([0.0, -math.cos(_ELEVATION_RAD), math.sin(_ELEVATION_RAD)])
    up = np.array([0.0, math.sin(_ELEVATION_RAD), math.cos(_ELEVATION_RAD)])
    t = math.tan(_FIELD_OF_VIEW_RAD / 2)
    corners = np.array([(x, y, z) for x in (0.0, size_m[0]) for y in (0.0, size_m[1]) for z in (0.0, 1.2)]) - centre
    u, b = corners @ up, corners @ back
    below, above = np.max(u + t * b), np.max(t * b - u)
    distance = max((below + above) / (2 * t), np.max(b + np.abs(corners[:, 0]) / (t * aspect)))
    target = centre + (below - above) / 2 * up
    return target + 1.03 * distance * back, target
