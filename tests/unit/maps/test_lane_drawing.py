import numpy as np
import pytest

from maps.errors import LaneError, PlanError, StationError
from maps.grid import GridMap
from maps.lane_drawing import draw_lanes, read_lanes
from maps.site import load_site, save_site, site_from_plan, site_names

RING = ["1>2", "^ v", "3<4"]


def test_a_ring_is_read_as_drawn():
    lanes = read_lanes(RING, 2, 2, where="test")
    assert lanes.tolist() == [[0, 1], [1, 3], [2, 0], [3, 2]]
    assert draw_lanes(np.array([list("12"), list("34")]), lanes, GridMap(np.ones((2, 2)))) == RING


def test_two_way_lanes_are_both():
    assert read_lanes(["a-b", "|", "c"], 2, 2, where="test").tolist() == [[0, 1], [0, 2], [1, 0], [2, 0]]


@pytest.mark.parametrize(
    ("lines", "expected"),
    [
        (["1>2", "^ v"], "2 lines; valid: 3"),
        (["1>2>3", "^ v", "3<4"], "line 0 has 5 characters; valid: at most 3"),
        (["1^2", "^ v", "3<4"], "line 0, column 1: '^' is no lane; valid: one of > < -"),
        (["1>2", "< v", "3<4"], "line 1, column 0: '<' is no lane; valid: one of ^ v |"),
        (["1>2", "^>v", "3<4"], "line 1, column 1: '>' is no lane; valid: a space"),
        (["1|2", "^ v", "3<4"], "line 0, column 1: '|' is no lane"),
    ],
)
def test_what_is_no_lane_is_refused_where_it_stands(lines, expected):
    with pytest.raises(PlanError, match=expected.replace("^", r"\^").replace("|", r"\|")):
        read_lanes(lines, 2, 2, where="test")


@pytest.mark.parametrize("name", site_names())
def test_a_site_with_given_lanes_is_read_back(name, tmp_path):
    site = load_site(name)
    given = site_from_plan(site.plan, name=name, allow_reverse=site.allow_reverse, lanes=site.lanes)
    assert np.array_equal(given.lanes, site.lanes)
    assert np.array_equal(given.against, site.against)
    assert given.stations == site.stations
    save_site(given, tmp_path / "site.toml")
    assert load_site(tmp_path / "site.toml") == given


def test_given_lanes_that_lead_astray_are_refused():
    site = load_site("cell")
    reversed_one = site.lanes.copy()
    reversed_one[0] = reversed_one[0, ::-1]
    with pytest.raises(LaneError, match="row 1, column 1 is a dead end"):
        site_from_plan(site.plan, name="s", lanes=reversed_one)
    with pytest.raises(LaneError, match="two-way lane at row 1, column 1 without allow_reverse"):
        site_from_plan(site.plan, name="s", lanes=np.vstack([site.lanes, site.lanes[:, ::-1]]))
    with pytest.raises(PlanError, match="lanes lead to row 0, column 0, where nothing drives"):
        site_from_plan(site.plan, name="s", lanes=np.vstack([site.lanes, [[13, 0]]]))
    with pytest.raises(LaneError, match="no lanes"):
        site_from_plan(site.plan, name="s", lanes=np.empty((0, 2), dtype=np.int32))


def test_what_others_call_stations_is_kept(tmp_path):
    site = site_from_plan(load_site("cell").plan, name="cell", names={"pick_1": 'Gate "A"'})
    save_site(site, tmp_path / "cell.toml")
    assert load_site(tmp_path / "cell.toml") == site
    assert load_site(tmp_path / "cell.toml").names == {"pick_1": 'Gate "A"'}
    with pytest.raises(StationError, match=r"names\.pick_9 is no station; valid: one of pick_1, drop_1"):
        site_from_plan(site.plan, name="s", names={"pick_9": "x"})
    with pytest.raises(StationError, match="names has 'x' twice"):
        site_from_plan(site.plan, name="s", names={"pick_1": "x", "drop_1": "x"})
