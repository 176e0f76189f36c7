"""Waits, cells, congestion and scans, read back from the file."""

from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from fleet.recording import DrawnFloor, Frame, Wait
from fleet.recording.rerun_stream.coordination import chains, cyclic
from fleet.recording.rerun_stream.stream import palette
from fleet.world.scene import Scene
from tests.unit.fleet.recording.test_rerun_recorder import STEP_M, open_recorder, rows

Frames = Callable[[int], Iterator[Frame]]
CELLS = np.array([(x + 0.5, y + 0.5) for y in range(3) for x in range(4)])
RING = (
    Wait(who="car_0", whom="car_1", cause="cell"),
    Wait(who="car_1", whom="car_0", cause="cell"),
    Wait(who="car_2", whom="cell (1, 1)", cause="blocked", cell=5),
)


def test_who_waits_in_a_circle_is_found_and_who_only_waits_for_it_is_not() -> None:
    edges = [("a", "b"), ("b", "c"), ("c", "a"), ("d", "a"), ("e", "f"), ("g", "g")]
    assert cyclic(edges) == {"a", "b", "c", "g"}
    assert cyclic([]) == frozenset()


def test_nodes_of_the_graph_have_places_of_their_own_and_waiters_stand_beside_whom_they_wait_for() -> None:
    ahead = {f"car_{k}": f"car_{k + 1}" for k in range(4)} | {"car_9": "car_2", "car_7": "car_8", "car_8": "car_7"}
    names = sorted({*ahead, *ahead.values()})
    place = dict(zip(names, map(tuple, chains(names, ahead)), strict=True))
    assert len(set(place.values())) == len(names)
    for who, whom in [("car_0", "car_1"), ("car_3", "car_4"), ("car_9", "car_2")]:
        assert place[who][0] == place[whom][0] + 1


def test_many_short_chains_do_not_make_one_long_column() -> None:
    ahead = {f"car_{k}": f"arm_{k}" for k in range(40)}
    names = sorted({*ahead, *ahead.values()})
    column, row = chains(names, ahead).T
    assert row.max() <= 7
    assert len(set(zip(column, row, strict=True))) == 80


@pytest.fixture
def shown(tmp_path: Path, site: tuple[Scene, DrawnFloor], frames: Frames) -> tuple[Path, list[Frame]]:
    made = list(frames(4))
    held = np.full(12, -1, np.int32)
    held[[2, 7]] = 1, 0
    taken = held.copy()
    taken[2] = -1
    stood = {"traffic": np.zeros(12), "station": np.zeros(12)}
    stood["traffic"][[3, 4]] = 3.0, 30.0
    stood["station"][[4, 6]] = 10.0, 0.5
    scan = np.array([[1.0, 1.0, 0.2], [2.0, 1.0, 0.2]])
    made[0] = replace(made[0], held_by=held, waits=RING, explanations={"car_2": "car_2 has waited 3.0 s: x"})
    made[1] = replace(made[1], next_of=held, scan_origins=scan, scans=scan + np.array([0.0, 1.0, 0.0]))
    made[2] = replace(made[2], held_by=taken, waits=(), explanations={}, stood_s=stood)
    path = tmp_path / "a.rrd"
    with open_recorder(path, (site[0], replace(site[1], cell_xy=CELLS))) as recorder:
        for frame in made:
            recorder.record(frame)
    return path, made


def test_cells_are_drawn_in_the_colour_of_their_car(shown: tuple[Path, list[Frame]]) -> None:
    centres = rows(shown[0], "/world/cells/granted", "Boxes3D:centers")
    assert list(centres) == [0, 4]
    np.testing.assert_allclose(np.array(centres[0])[:, :2], CELLS[[2, 7]])
    np.testing.assert_allclose(np.array(centres[4])[:, :2], CELLS[[7]])
    colours = rows(shown[0], "/world/cells/granted", "Boxes3D:colors")[0]
    assert [colour >> 8 for colour in colours] == [palette.identity_colour(car) >> 8 for car in (1, 0)]
    assert list(rows(shown[0], "/world/cells/planned", "Boxes3D:centers")) == [2]


def test_waits_are_a_graph_and_arrows_with_circles_in_red(shown: tuple[Path, list[Frame]]) -> None:
    """A friction of the first hour: who waits for whom had to be guessed, and a circle, too."""
    path, made = shown
    edges = rows(path, "/world/waits", "GraphEdges:edges")
    assert [tuple(edge.values()) for edge in edges[0]] == [(wait.who, wait.whom) for wait in RING]
    assert edges[4] == []
    names = rows(path, "/world/waits", "GraphNodes:labels")[0]
    colours = dict(zip(names, rows(path, "/world/waits", "GraphNodes:colors")[0], strict=True))
    assert {name for name, colour in colours.items() if colour == palette.CYCLE} == {"car_0", "car_1"}
    arrows = rows(path, "/world/waits", "Arrows3D:colors")
    assert arrows[0] == [palette.CYCLE, palette.CYCLE, palette.WAIT]
    assert arrows[4] == []
    origin = np.array(rows(path, "/world/waits", "Arrows3D:origins")[0])[:, :2]
    tip = origin + np.array(rows(path, "/world/waits", "Arrows3D:vectors")[0])[:, :2]
    np.testing.assert_allclose(origin, made[0].car_poses[[0, 1, 2], :2], atol=1e-5)
    np.testing.assert_allclose(tip, [*made[0].car_poses[[1, 0], :2], CELLS[5]], atol=1e-5)


def test_explanations_are_told_as_long_as_somebody_waits(shown: tuple[Path, list[Frame]]) -> None:
    texts = rows(shown[0], "/world/waits", "TextDocument:text")
    assert texts == {0: ["**car_2**: has waited 3.0 s: x"], 4: ["Nobody waits."]}


def test_a_cell_is_shared_by_its_causes_in_proportion(shown: tuple[Path, list[Frame]]) -> None:
    path, _ = shown
    traffic = np.array(rows(path, "/world/congestion/traffic", "Boxes3D:half_sizes")[4])
    station = np.array(rows(path, "/world/congestion/station", "Boxes3D:half_sizes")[4])
    np.testing.assert_allclose(traffic[:, 0], [0.5, 0.375])
    np.testing.assert_allclose(station[:, 0], [0.125], err_msg="a cell with half a second in all is left out")
    left = np.array(rows(path, "/world/congestion/traffic", "Boxes3D:centers")[4])[1, 0] - 0.375
    right = np.array(rows(path, "/world/congestion/station", "Boxes3D:centers")[4])[0, 0] + 0.125
    assert (left, right) == (pytest.approx(CELLS[4, 0] - 0.5), pytest.approx(CELLS[4, 0] + 0.5))


def test_scans_are_rays_and_hits(shown: tuple[Path, list[Frame]]) -> None:
    path, made = shown
    hits = rows(path, "/world/scans/hits", "Points3D:positions")
    assert list(hits) == [2]
    assert made[1].scans is not None
    np.testing.assert_allclose(hits[2], made[1].scans, atol=STEP_M)
    rays = np.array(rows(path, "/world/scans/rays", "LineStrips3D:strips")[2])
    np.testing.assert_allclose(rays[:, 1], made[1].scans, atol=STEP_M)
