"""Drawings: pictures of the concepts, made from sites and runs when the site is built."""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
import numpy.typing as npt

from fleet.arrays import FloatArray
from fleet.charts.chart import COLORS
from fleet.charts.drawing import Box, Drawing, Line, Words
from fleet.config import Fidelity, RunConfig
from fleet.insight.causes import Column
from fleet.replay.floor_sheet import EDGE, INK, FloorSheet
from fleet.simulation import Simulation
from maps.lane_graph import MoveKind, build_lane_graph
from maps.site import load_site

SITE = "small"
MOMENT = RunConfig(site=SITE, robots=6, seed=3, fidelity=Fidelity.KINEMATIC)
MOMENT_S = 25.0
"""When one car waits for another that is served, while four are on their way [s]."""
KIND_COLORS = {MoveKind.STRAIGHT: COLORS[0], MoveKind.LEFT: COLORS[2], MoveKind.RIGHT: COLORS[1]}
STATE_COLORS = dict(
    zip(
        ("ready", "assigned", "loading", "carried", "unloading", "delivered"),
        ("#d9d9d9", "#56b4e9", "#cc79a7", "#0072b2", "#e69f00", "#009e73"),
        strict=True,
    )
)


def site() -> Drawing:
    """A whole site: what its cells are for, and its lanes."""
    sheet = FloorSheet(load_site(SITE), px_per_m=46)
    sheet.cells()
    sheet.lanes()
    sheet.station_names()
    return sheet.drawing


def lane_graph() -> Drawing:
    """A few cells with the states in them, the moves between those, and the cells that one move sweeps."""
    place = load_site(SITE)
    graph = build_lane_graph(place)
    rows, cols = (3, 8), (1, 8)
    sheet = FloorSheet(place, px_per_m=100, rows=rows, cols=cols)
    sheet.cells()

    def inside(state: int) -> bool:
        row, col = divmod(int(graph.state_cell[state]), place.grid.cols)
        return rows[0] <= row < rows[1] and cols[0] <= col < cols[1]

    moves = [
        move for move in range(graph.n_moves) if inside(int(graph.move_from[move])) and inside(int(graph.move_to[move]))
    ]
    turn = next(move for move in moves if graph.move_kind[move] == MoveKind.LEFT)
    for cell in graph.swept_cell[graph.swept_ptr[turn] : graph.swept_ptr[turn + 1]].tolist():
        sheet.cell(cell, COLORS[3], share=1.0 - EDGE, opacity=0.35, title="swept by the thick move")
    for move in moves:
        points = graph.path_points[graph.path_ptr[move] : graph.path_ptr[move + 1], :2]
        color = KIND_COLORS[MoveKind(int(graph.move_kind[move]))]
        sheet.line(points, color, width=4.0 if move == turn else 1.5)
    for state in filter(inside, range(graph.n_states)):
        x, y, yaw = graph.state_pose[state].tolist()
        ahead = np.array([np.cos(yaw), np.sin(yaw)])
        sheet.arrow(np.array([x, y]), np.array([x, y]) + 0.26 * ahead, INK, width=2.0)
        sheet.square(x, y, 0.08, INK, title=f"state {state}")
    return sheet.drawing


def task() -> Drawing:
    """The states of the tasks of a short run, over time."""
    bars: dict[str, list[tuple[float, float, str]]] = {}
    with Simulation(RunConfig(site="cell", robots=2, tasks=3, seed=1, fidelity=Fidelity.KINEMATIC)) as run:
        since = {one.order.name: (0.0, str(one.state)) for one in run.board.tasks}
        while not run.finished:
            run.tick()
            for one in run.board.tasks:
                begun_s, state = since[one.order.name]
                if str(one.state) != state:
                    bars.setdefault(one.order.name, []).append((begun_s, run.sim_s, state))
                    since[one.order.name] = (run.sim_s, str(one.state))
        end_s = run.sim_s
    return _gantt(bars, end_s)


@dataclass(frozen=True, kw_only=True)
class Moment:
    """How the cars of a run stand, what they hold and where they are to go."""

    poses: FloatArray
    granted: tuple[FloatArray, ...]
    """Ways that cars may drive, x, y [m]."""
    planned: tuple[FloatArray, ...]
    """Ways beyond."""
    holders: npt.NDArray[np.int32]
    """Car that holds each cell, -1 = nobody."""
    next_visitors: npt.NDArray[np.int32]
    """Car that comes next into each cell."""
    waits: dict[int, int]
    """Which car waits for which."""


@functools.cache
def moment() -> Moment:
    """The moment that `plan` and `grants` show."""
    with Simulation(MOMENT) as run:
        while run.sim_s < MOMENT_S:
            run.tick()
        graph = run.executor.dependencies
        by = run.causes.rows[: MOMENT.robots, Column.BY].tolist()
        return Moment(
            poses=run.world.car_poses().copy(),
            granted=run.driver.remaining_lines(),
            planned=run.executor.planned_lines(),
            holders=graph.holders(),
            next_visitors=graph.next_visitors(),
            waits={car: other for car, other in enumerate(by) if 0 <= other < MOMENT.robots},
        )


def plan() -> Drawing:
    """Where all cars are to drive: granted ways are drawn through, planned ones dashed."""
    seen, sheet = moment(), _floor()
    for car, (granted, planned) in enumerate(zip(seen.granted, seen.planned, strict=True)):
        for points, dashed in ((granted, False), (planned, True)):
            if len(points) > 1:
                sheet.line(points[:, :2], COLORS[car], width=3.0, dashed=dashed)
    _cars(sheet, seen)
    return sheet.drawing


def grants() -> Drawing:
    """The cells that each car holds, those into which it comes next, and who waits for whom."""
    seen, sheet = moment(), _floor()
    for cell, (holder, visitor) in enumerate(zip(seen.holders.tolist(), seen.next_visitors.tolist(), strict=True)):
        if holder >= 0:
            sheet.cell(cell, COLORS[holder], share=1.0 - EDGE, opacity=0.55, title=f"held by car_{holder}")
        if visitor not in (-1, holder):
            sheet.cell(cell, COLORS[visitor], share=0.3, title=f"car_{visitor} comes next")
    _cars(sheet, seen)
    for car, other in seen.waits.items():
        sheet.arrow(_middle(seen.poses[car]), _middle(seen.poses[other]), "#c00000", width=2.5)
    return sheet.drawing


def tick() -> Drawing:
    """The parts of a tick, in their order: those that decide now and then, and those that act in every tick."""
    slow = ("dispatcher", "traffic")
    notes = {
        "incidents": "what goes wrong",
        "dispatcher": "which car, which task",
        "traffic": "a plan for all cars",
        "executor": "grants, commands",
        "arms": "motions as planned",
        "world": "physics or a model",
        "figures": "causes, accounts",
    }
    sheet = Drawing(width=760, height=150)
    marks = sheet.marks
    step, size = 108.0, (92.0, 58.0)
    for k, (name, note) in enumerate(notes.items()):
        x = 6.0 + k * step
        marks.append(Box(at=(x, 46.0), size=size, color=COLORS[0 if name in slow else 2], opacity=0.18))
        marks.append(Words(at=(x + size[0] / 2, 70.0), text=name, size=14, anchor="middle", bold=True))
        marks.append(Words(at=(x + size[0] / 2, 90.0), text=note, size=8.5, anchor="middle"))
        if k:
            tip = (x - 3.0, 75.0)
            marks.append(Line(points=[(x - step + size[0] + 2.0, 75.0), tip], color=INK, width=1.5))
            marks.append(Line(points=[(tip[0] - 5, 71.0), tip, (tip[0] - 5, 79.0)], color=INK, width=1.5))
    marks.append(Words(at=(6.0 + step, 32.0), text="decides when something changes", size=12, color=COLORS[0]))
    marks.append(Words(at=(6.0 + 3 * step, 32.0), text="acts in every tick", size=12, color=COLORS[2]))
    last = 6.0 + 6 * step + size[0] / 2
    back = [(last, 108.0), (last, 130.0), (52.0, 130.0), (52.0, 108.0)]
    marks.append(Line(points=back, color=INK, width=1.5))
    marks.append(Line(points=[(48.0, 113.0), (52.0, 107.0), (56.0, 113.0)], color=INK, width=1.5))
    return sheet


def fidelity() -> Drawing:
    """How far one car has come over time, in three worlds with the same orders."""
    width, height, left, bottom, last_s = 760, 300, 56.0, 250.0, 24.0
    ways = {kind: _way(kind, last_s) for kind in (Fidelity.GRID, Fidelity.KINEMATIC, Fidelity.PHYSICS)}
    top_m = max(float(way[-1, 1]) for way in ways.values())
    sheet = Drawing(width=width, height=height)
    marks = sheet.marks
    for k in range(7):
        x = left + k * (width - left - 20.0) / 6
        marks.append(Line(points=[(x, 30.0), (x, bottom)], color="#e4e4e4"))
        marks.append(Words(at=(x, bottom + 18.0), text=f"{k * last_s / 6:g}", anchor="middle"))
    for metres in range(0, int(top_m) + 1, 4):
        y = bottom - metres / top_m * (bottom - 30.0)
        marks.append(Line(points=[(left, y), (width - 20.0, y)], color="#e4e4e4"))
        marks.append(Words(at=(left - 8.0, y + 4.0), text=str(metres), anchor="end"))
    marks.append(Words(at=(left, 18.0), text="way driven by car_0 [m]", size=12))
    marks.append(Words(at=(width - 20.0, bottom + 38.0), text="simulated time [s]", anchor="end"))
    for color, (kind, way) in zip(COLORS, ways.items(), strict=False):
        spots = [(left + t / last_s * (width - left - 20.0), bottom - s / top_m * (bottom - 30.0)) for t, s in way]
        # The kinematic car is as fast as the physical one: its line shows behind the other.
        marks.append(Line(points=spots, color=color, width=5.0 if kind is Fidelity.KINEMATIC else 1.5))
        marks.append(Words(at=(320.0 + 120.0 * list(ways).index(kind), 18.0), text=str(kind), color=color, bold=True))
    return sheet


DRAWINGS: Mapping[str, Callable[[], Drawing]] = MappingProxyType(
    {one.__name__: one for one in (site, lane_graph, task, plan, grants, tick, fidelity)}
)
"""By the word that a page says."""


def figure(name: str) -> str:
    """A drawing as it stands in a page."""
    return f"<figure>\n{DRAWINGS[name]().svg()}\n</figure>"


def _way(kind: Fidelity, last_s: float) -> FloatArray:
    """Time and way driven of car_0, once every quarter of a second, shape (k, 2)."""
    rows = [(0.0, 0.0)]
    with Simulation(RunConfig(site="cell", robots=2, tasks=2, seed=0, fidelity=kind)) as run:
        at = run.world.car_poses()[0, :2].copy()
        driven = 0.0
        while run.sim_s < last_s and not run.finished:
            run.tick()
            now = run.world.car_poses()[0, :2]
            driven += float(np.hypot(*(now - at)))
            at = now.copy()
            if run.sim_s >= rows[-1][0] + 0.25:
                rows.append((run.sim_s, driven))
    return np.array(rows)


def _floor() -> FloorSheet:
    sheet = FloorSheet(load_site(SITE), px_per_m=46)
    sheet.cells()
    return sheet


def _cars(sheet: FloorSheet, seen: Moment) -> None:
    for car, pose in enumerate(seen.poses):
        sheet.car(pose, COLORS[car])
        x, y = sheet.spot(*_middle(pose))
        sheet.words((x, y - 12.0), f"car_{car}", size=11, anchor="middle", bold=True)


def _middle(pose: FloatArray) -> FloatArray:
    return pose[:2] + 0.16 * np.array([np.cos(pose[2]), np.sin(pose[2])])


def _gantt(bars: dict[str, list[tuple[float, float, str]]], end_s: float) -> Drawing:
    left, right, row_px = 80.0, 20.0, 30.0
    sheet = Drawing(width=760, height=round(60 + row_px * len(bars)))
    marks, scale = sheet.marks, (760 - left - right) / end_s
    x = left
    for state, color in STATE_COLORS.items():
        marks.append(Box(at=(x, 8.0), size=(12.0, 12.0), color=color))
        marks.append(Words(at=(x + 18.0, 19.0), text=state))
        x += 40.0 + 7.0 * len(state)
    for row, (name, pieces) in enumerate(bars.items()):
        y = 34.0 + row * row_px
        marks.append(Words(at=(left - 8.0, y + 16.0), text=name, anchor="end"))
        for begin_s, until_s, state in pieces:
            if state in STATE_COLORS:
                size = ((until_s - begin_s) * scale, row_px - 8.0)
                title = f"{name} {state}, {begin_s:.1f} to {until_s:.1f} s"
                marks.append(Box(at=(left + begin_s * scale, y), size=size, color=STATE_COLORS[state], title=title))
    bottom = 34.0 + len(bars) * row_px
    for second in range(0, int(end_s) + 1, 10):
        marks.append(Words(at=(left + second * scale, bottom + 16.0), text=f"{second} s", size=11, anchor="middle"))
    return sheet
