"""A run and its recording side by side: what the file tells is what the simulation had."""

import itertools
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fleet.config import Fidelity, RunConfig
from fleet.insight.causes import OWN, Cause, Column
from fleet.session.frames import CONGESTION, Watch, open_recorder
from fleet.simulation import Simulation
from fleet.stations.arms import arm_cell
from planners.motion.arm.kinematics import link_frames
from tests.unit.fleet.recording.test_rerun_recorder import STEP_M, rows


@dataclass
class Seen:
    """What the simulation had, by tick."""

    path: Path
    cars: dict[int, np.ndarray] = field(default_factory=dict)
    arms: dict[int, np.ndarray] = field(default_factory=dict)
    parcels: dict[int, np.ndarray] = field(default_factory=dict)
    holders: dict[int, np.ndarray] = field(default_factory=dict)
    waits: dict[int, set[tuple[str, str]]] = field(default_factory=dict)
    reasons: dict[int, dict[str, str]] = field(default_factory=dict)
    stood_ticks: np.ndarray | None = None
    simulation: Any = None


@pytest.fixture(scope="module")
def seen(tmp_path_factory: pytest.TempPathFactory) -> Seen:
    """Forty seconds of eight cars on the site small, where they get in each other's way."""
    run = Seen(path=tmp_path_factory.mktemp("run") / "a.rrd")
    config = RunConfig(site="small", robots=12, fidelity=Fidelity.KINEMATIC, duration_s=40.0)
    with Simulation(config) as simulation, open_recorder(simulation.view, run.path) as recorder:
        watch = Watch(simulation.view, simulation.figures, recorder, lidar=True)
        run.simulation = simulation
        run.stood_ticks = np.zeros((len(Cause), simulation.graph.n_cells))
        while not simulation.finished:
            simulation.tick()
            watch.look()
            _note(run, simulation)
    return run


def _note(run: Seen, simulation: Simulation) -> None:
    world, tick = simulation.world, simulation.now
    names, causes = simulation.codebook.robots, simulation.causes.rows
    run.cars[tick] = world.car_poses()
    run.arms[tick] = world.arm_positions()
    run.parcels[tick] = world.parcel_poses()
    run.holders[tick] = simulation.executor.dependencies.holders()
    kept = [k for k, row in enumerate(causes) if Cause(row[Column.CAUSE]) not in OWN]
    run.waits[tick] = {
        (names[k], names[causes[k, Column.BY]])
        for k in kept
        if causes[k, Column.BY] >= 0 and causes[k, Column.CAUSE] != Cause.AWAITS
    }
    now_s = simulation.sim_s - simulation.tick_s
    found = {names[k]: simulation.explain(names[k], now_s) for k in kept}
    run.reasons[tick] = {name: f"{why}; {why.orders}" if why.orders else str(why) for name, why in found.items()}
    for car, (x, y, _) in enumerate(world.car_poses()):
        cell = simulation.site.grid.index(*simulation.site.grid.cell_at(x, y))
        run.stood_ticks[causes[car, Column.CAUSE], cell] += 1


def test_every_car_is_where_it_was(seen: Seen) -> None:
    recorded = rows(seen.path, "/world/cars/body", "InstancePoses3D:translations")
    turns = rows(seen.path, "/world/cars/body", "InstancePoses3D:quaternions")
    assert list(recorded) == list(seen.cars)
    for tick, poses in seen.cars.items():
        np.testing.assert_allclose(np.array(recorded[tick])[:, :2], poses[:, :2], atol=STEP_M)
        z, w = np.array(turns[tick])[:, 2:].T
        apart = (2 * np.arctan2(z, w) - poses[:, 2] + np.pi) % (2 * np.pi) - np.pi
        assert np.abs(apart).max() < 1e-3


def test_every_arm_is_where_forward_kinematics_puts_it(seen: Seen) -> None:
    recorded = rows(seen.path, "/world/arms/link_7", "InstancePoses3D:translations")
    spec, base = seen.simulation.scene.arms.specs[0], seen.simulation.scene.arm_base
    assert len(recorded) > 20
    for tick in list(recorded)[::10]:
        for arm, q in enumerate(seen.arms[tick]):
            x, y, z = link_frames(spec.base_from_joint, q)[-1][:3, 3]
            cos, sin = np.cos(base[arm, 3]), np.sin(base[arm, 3])
            expected = base[arm, :3] + (cos * x - sin * y, sin * x + cos * y, z)
            np.testing.assert_allclose(recorded[tick][arm], expected, atol=STEP_M)


def test_an_arm_without_a_row_has_not_moved(seen: Seen) -> None:
    recorded = set(rows(seen.path, "/world/arms/link_7", "InstancePoses3D:translations"))
    ticks = list(seen.arms)
    for before, tick in itertools.pairwise(ticks):
        if tick not in recorded:
            np.testing.assert_array_equal(seen.arms[tick], seen.arms[before])


def test_every_parcel_is_where_it_was(seen: Seen) -> None:
    recorded = rows(seen.path, "/world/parcels", "Boxes3D:centers")
    for tick, poses in seen.parcels.items():
        np.testing.assert_allclose(np.reshape(recorded[tick], (-1, 3)), poses[:, :3], atol=STEP_M)


def test_cells_are_held_by_whom_the_executor_granted_them(seen: Seen) -> None:
    recorded = rows(seen.path, "/world/cells/granted", "Boxes3D:centers")
    assert len(recorded) > 100
    xy = seen.simulation.site.grid.cell_xy(np.arange(seen.simulation.graph.n_cells))
    for tick, centres in recorded.items():
        np.testing.assert_allclose(np.array(centres)[:, :2], xy[seen.holders[tick] >= 0])


def test_the_graph_is_who_waited_for_whom(seen: Seen) -> None:
    recorded = rows(seen.path, "/world/waits", "GraphEdges:edges")
    assert sum(map(len, recorded.values())) > 5
    for tick, edges in recorded.items():
        between = {tuple(edge.values()) for edge in edges}
        robots = set(seen.simulation.codebook.robots)
        assert {edge for edge in between if edge[1] in robots} == seen.waits[tick]


def test_the_reasons_of_a_moment_are_those_of_that_moment(seen: Seen) -> None:
    recorded = rows(seen.path, "/world/waits", "TextDocument:text")
    assert len(recorded) > 10
    for tick, (text,) in recorded.items():
        expected = [f"**{name}**: {reason.removeprefix(name).strip()}" for name, reason in seen.reasons[tick].items()]
        assert text == ("\n\n".join(expected) or "Nobody waits.")


def test_cells_in_which_cars_stood_are_marked_and_no_others(seen: Seen) -> None:
    """Sampled five times a second, from a second on; so between half a second and two either is right."""
    assert seen.stood_ticks is not None
    xy = seen.simulation.site.grid.cell_xy(np.arange(seen.simulation.graph.n_cells))
    for name in ("traffic", "station"):
        rows_of_time = rows(seen.path, f"/world/congestion/{name}", "Boxes3D:centers")
        last = max(rows_of_time)
        marked = np.array(rows_of_time[last])[:, :2]
        stood_s = seen.stood_ticks[list(CONGESTION[name])].sum(axis=0) * seen.simulation.tick_s
        beside_m = np.abs(xy[:, None] - marked[None]).max(axis=2).min(axis=1)
        is_marked = beside_m <= 0.5 + 1e-6
        late_s = (max(seen.cars) - last) * seen.simulation.tick_s
        assert is_marked[stood_s >= 2.0 + late_s].all()
        assert not is_marked[_neighbourhood_s(seen, stood_s) == 0.0].any()


def _neighbourhood_s(seen: Seen, stood_s: np.ndarray) -> np.ndarray:
    """Time in a cell and the cells beside it: a strip at the edge of a cell is as near to its neighbour."""
    n_rows, n_cols = seen.simulation.site.grid.rows, seen.simulation.site.grid.cols
    padded = np.pad(stood_s.reshape(n_rows, n_cols), 1)
    return sum(
        padded[1 + dr : 1 + dr + n_rows, 1 + dc : 1 + dc + n_cols] for dr in (-1, 0, 1) for dc in (-1, 0, 1)
    ).ravel()


def test_scans_end_on_walls_or_robots(seen: Seen) -> None:
    recorded = rows(seen.path, "/world/scans/hits", "Points3D:positions")
    width, depth = seen.simulation.scene.size_m
    for hits in recorded.values():
        x, y, _ = np.array(hits).T
        assert -0.01 <= x.min() <= x.max() <= width + 0.01
        assert -0.01 <= y.min() <= y.max() <= depth + 0.01


def test_search_trees_are_recorded_on_request_and_change_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A post stands beside each arm: on the sites that ship every way is a straight line in joint space."""
    fence = arm_cell._fence

    def with_post(base: np.ndarray) -> list:
        aside = base[3] - np.pi / 2
        centre = np.array([base[0] + 0.45 * np.cos(aside), base[1] + 0.45 * np.sin(aside), 0.5])
        return [*fence(base), arm_cell._Box(centre, np.array([0.04, 0.04, 0.5]))]

    monkeypatch.setattr(arm_cell, "_fence", with_post)
    config = RunConfig(site="small", robots=2, tasks=2, fidelity=Fidelity.KINEMATIC, duration_s=25.0)
    hashes = []
    shown: dict[tuple[int, int], np.ndarray] = {}
    for internals in (False, True):
        path = tmp_path / f"{internals}.rrd"
        with Simulation(config) as simulation, open_recorder(simulation.view, path, internals=internals) as recorder:
            watch = Watch(simulation.view, simulation.figures, recorder, internals=internals)
            while not simulation.finished:
                simulation.tick()
                shown |= {(arm, simulation.now): edges for arm, edges in simulation.arm_manager.trees.items()}
                watch.look()
            hashes.append(simulation.world.state_bytes())
            scene = simulation.scene
            dock_cells = [int(simulation.graph.state_cell[station.dock_state]) for station in simulation.stations]
            docks = simulation.site.grid.cell_xy(dock_cells)
    assert hashes[0] == hashes[1]
    assert not rows(tmp_path / "False.rrd", "/world/trees/**", "LineStrips3D:strips")
    assert max(map(len, shown.values())) > 3
    for arm, base in enumerate(scene.arm_base):
        recorded = rows(path, f"/world/trees/arm_{arm}", "LineStrips3D:strips")
        assert list(recorded) == [tick for other, tick in shown if other == arm]
        for tick, edges in recorded.items():
            np.testing.assert_allclose(np.reshape(edges, (-1, 2, 3)), shown[arm, tick], atol=1e-5)
            tips = np.reshape(edges, (-1, 3))
            assert np.linalg.norm(tips - base[:3], axis=1).max(initial=0.0) < 1.5
            # What is searched for is the way between the rack and the tray of a car at the dock.
            assert not len(tips) or np.linalg.norm(tips[:, :2] - docks[arm], axis=1).min() < 0.02


def test_every_car_has_a_line_for_its_delay(seen: Seen) -> None:
    recorded = rows(seen.path, "/metrics/delay", "Scalars:scalars")
    delays_s = np.array(list(recorded.values()))
    assert delays_s.shape == (len(recorded), 12)
    assert len(recorded) >= 70  # twice a second
    # Where twelve cars meet some are held up; nobody is early by more than a turn and a dock make.
    assert 5.0 < np.nanmax(delays_s) < 40.0
    assert np.nanmin(delays_s) > -3.0
