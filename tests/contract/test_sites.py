"""What every shipped site must fulfil, whose list is the folder maps/data, and every generated one."""

import networkx as nx
import numpy as np
import pytest

from maps.lane_graph import build_lane_graph
from maps.report import check_site
from maps.site import load_site, save_site, site_names
from maps.warehouse import generate_warehouse

EXPECTED = {
    "cell": {"picks": 1, "drops": 1, "parking": 2, "rows": (6, 9), "cols": (8, 14)},
    "small": {"picks": 2, "drops": 2, "parking": 10, "rows": (11, 14), "cols": (15, 18)},
    "twin": {"picks": 2, "drops": 2, "parking": 12, "rows": (9, 12), "cols": (12, 16)},
    "dense": {"picks": 3, "drops": 3, "parking": 40, "rows": (14, 14), "cols": (22, 22)},
    "dense_large": {"picks": 6, "drops": 6, "parking": 120, "rows": (24, 24), "cols": (40, 40)},
    "two_way": {"picks": 3, "drops": 3, "parking": 8, "rows": (14, 14), "cols": (19, 19)},
    "medium": {"picks": 6, "drops": 6, "parking": 24, "rows": (22, 26), "cols": (38, 42)},
}


GENERATED = {
    "generated_islands": {"pick": 8, "drop": 8, "sides": "none", "islands": True},
    "generated_four_sides": {"pick": 8, "drop": 8, "sides": "nesw"},
    "generated_both": {"pick": 20, "drop": 25, "sides": "nesw", "islands": True, "lanes": 2},
}


@pytest.fixture(scope="module", params=[*site_names(), *GENERATED])
def site(request):
    if request.param in GENERATED:
        return generate_warehouse(rows=30, cols=42, parking=30, name=request.param, **GENERATED[request.param])
    return load_site(request.param)


def test_known_sites_ship():
    assert set(EXPECTED) <= set(site_names())


def test_name_is_the_file_name(site):
    assert site.name in {*site_names(), *GENERATED}


@pytest.mark.parametrize("name", EXPECTED)
def test_size_and_stations(name):
    report, expected = check_site(load_site(name)), EXPECTED[name]
    assert (report.picks, report.drops) == (expected["picks"], expected["drops"])
    assert report.parking >= expected["parking"]
    assert expected["rows"][0] <= report.rows <= expected["rows"][1]
    assert expected["cols"][0] <= report.cols <= expected["cols"][1]


def test_good_for_traffic(site):
    report = check_site(site)
    assert report.warnings == ()
    assert report.path_ratio <= 1.5
    assert report.cut_cells == ()


def test_every_car_can_go_anywhere(site):
    graph = build_lane_graph(site)
    assert nx.is_strongly_connected(graph.to_networkx())
    for cell in [*(station.dock.cell for station in site.stations), *site.parking, *site.chargers]:
        assert len(graph.states_of_cell(cell)) == 1


def test_no_lane_runs_both_ways_unless_reverse_is_allowed(site):
    lanes = {tuple(lane) for lane in site.lanes.tolist()}
    assert site.allow_reverse or all((b, a) not in lanes for a, b in lanes)


def test_cars_pass_docks_straight(site):
    for station in site.stations:
        assert station.dock.stop_offset_m == pytest.approx(0.24)


def test_arms_have_room(site):
    bases = np.array([station.arm.pose[:2] for station in site.stations])
    docks = np.array([station.dock.cell for station in site.stations])
    apart = np.hypot(*(bases[:, None] - bases[None]).transpose(2, 0, 1)) + 10 * np.eye(len(bases))
    assert apart.min() >= 1.1
    assert apart[docks[:, None] != docks].min() >= 2.0
    built = np.argwhere(site.walls | site.shelves)
    centres = site.grid.cell_xy(site.grid.index(built[:, 0], built[:, 1]))
    for base in bases:
        gap = np.maximum(np.abs(centres - base) - 0.5, 0.0)
        # Slots reach 0.53 m from the base, the parcels on them a little more; nothing tall stands nearer than that.
        assert np.hypot(*gap.T).min() >= 0.8


def test_reads_back_equal(site, tmp_path):
    save_site(site, tmp_path / "again.toml")
    assert load_site(tmp_path / "again.toml") == site
