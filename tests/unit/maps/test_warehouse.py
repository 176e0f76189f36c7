import hashlib

import numpy as np
import pytest

from maps.errors import PlanError
from maps.report import check_site
from maps.warehouse import generate_warehouse


@pytest.mark.parametrize(
    ("rows", "cols", "pick", "drop", "parking", "chargers"),
    [
        (7, 9, 1, 1, 1, 0),
        (13, 16, 2, 2, 12, 2),
        (24, 40, 6, 3, 40, 4),
        (40, 31, 1, 11, 0, 0),
        (50, 90, 10, 10, 150, 20),
    ],
)
def test_any_size_works_and_is_good_for_traffic(rows, cols, pick, drop, parking, chargers):
    site = generate_warehouse(rows=rows, cols=cols, pick=pick, drop=drop, parking=parking, chargers=chargers)
    report = check_site(site)
    assert (report.rows, report.cols) == (rows, cols)
    assert (report.picks, report.drops, report.parking, report.chargers) == (pick, drop, parking, chargers)
    assert report.cut_cells == ()
    assert not any("blocks" in line for line in report.warnings)
    assert report.path_ratio <= (1.5 if rows > 10 else 2.0)


@pytest.mark.parametrize("rack", [(1, 1), (1, 10), (3, 4)])
def test_rack_blocks_of_any_shape(rack):
    site = generate_warehouse(rows=25, cols=33, pick=2, drop=2, parking=10, rack_rows=rack[0], rack_cols=rack[1])
    report = check_site(site)
    assert report.path_ratio <= 1.5
    assert report.cut_cells == ()
    assert site.shelves.any()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"rows": 5}, "rows is 5; valid: at least 7"),
        ({"pick": 0}, "pick is 0; valid: at least 1"),
        ({"drop": 20}, "drop is 20; valid: at most 3, the docks that fit along 13 rows"),
        ({"parking": 500}, "500 parking and charging cells; valid: at most 45"),
        ({"rack_cols": 0}, "rack_cols is 0"),
    ],
)
def test_impossible_numbers_are_refused(change, message):
    with pytest.raises(PlanError, match=message):
        generate_warehouse(**({"rows": 13, "cols": 16, "pick": 1, "drop": 1, "parking": 4} | change))


TODAY = {
    (24, 40, 6, 6, 24, 0, 2, 5): "b1805936",
    (60, 100, 18, 18, 200, 4, 2, 5): "1c83521b",
    (33, 41, 3, 7, 31, 2, 3, 4): "22863380",
}


@pytest.mark.parametrize("numbers", TODAY)
def test_floors_without_new_arguments_stay_as_they_were(numbers):
    names = ("rows", "cols", "pick", "drop", "parking", "chargers", "rack_rows", "rack_cols")
    site = generate_warehouse(**dict(zip(names, numbers, strict=True)))
    assert hashlib.sha256("\n".join(site.plan).encode()).hexdigest()[:8] == TODAY[numbers]


@pytest.mark.parametrize("sides", ["we", "nesw", "none"])
@pytest.mark.parametrize("lanes", [1, 2, 3])
def test_stations_stand_on_the_chosen_walls_and_between_the_racks(sides, lanes):
    site = generate_warehouse(rows=50, cols=70, pick=30, drop=25, parking=60, sides=sides, islands=True, lanes=lanes)
    report = check_site(site)
    assert (report.picks, report.drops, report.parking) == (30, 25, 60)
    assert report.cut_cells == ()
    assert report.warnings == ()
    row, col = site.grid.row_col(np.array([station.dock.cell for station in site.stations]))
    kind = np.array([station.kind for station in site.stations])
    on_wall = {"w": col == 1, "e": col == 68, "n": row == 1, "s": row == 48}
    for wall, owner in zip("wnes", ("pick", "pick", "drop", "drop"), strict=True):
        assert on_wall[wall].any() == (sides != "none" and wall in sides)
        assert set(kind[on_wall[wall]]) <= {owner}
    inside = ~np.any(list(on_wall.values()), axis=0)
    assert inside.any() == (sides != "nesw")


def test_islands_of_both_kinds_are_spread_over_the_floor():
    site = generate_warehouse(rows=60, cols=80, pick=24, drop=12, parking=40, sides="none", islands=True)
    for kind in ("pick", "drop"):
        cells = np.array([station.dock.cell for station in site.stations if station.kind == kind])
        row, col = site.grid.row_col(cells)
        assert abs(row.mean() - 29.5) < 6
        assert abs(col.mean() - 39.5) < 6
        assert np.ptp(row) > 20
        assert np.ptp(col) > 50


def test_cars_come_straight_to_islands_and_a_car_beside_them_waits_off_the_aisle():
    site = generate_warehouse(rows=40, cols=60, pick=10, drop=10, parking=20, sides="none", islands=True)
    lanes = {tuple(lane) for lane in site.lanes.tolist()}
    for station in site.stations:
        dock, ahead = station.dock.cell, station.dock.heading
        before = site.grid.neighbour(dock, (ahead + 2) % 4)
        assert (before, dock) in lanes
        assert (dock, site.grid.neighbour(dock, ahead)) in lanes
        # The cell before leads to the dock only: who waits there is passed by nobody.
        assert [lane for lane in lanes if lane[0] == before] == [(before, dock)]


def test_lanes_lie_side_by_side_between_blocks():
    site = generate_warehouse(rows=30, cols=44, pick=2, drop=2, parking=10, lanes=3)
    # Blocks of 2 x 5 begin in the fifth row, below the parking, and in the fourth column.
    assert site.plan[4][3:-3] == site.plan[5][3:-3] == "=====...=====...=====...=====...=====."
    assert all(set(site.plan[row][1:-1]) <= set(".PD") for row in (6, 7, 8))
    assert site.plan[9][3:8] == "====="


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"sides": "ns"}, "sides is 'ns'; valid: one of we, nesw, none"),
        ({"sides": "none"}, "sides is none without islands; valid: one of we, nesw, or islands"),
        ({"lanes": 0}, "lanes is 0; valid: at least 1"),
        ({"lanes": 50}, "lanes is 50; valid: at most"),
        ({"islands": True, "rack_cols": 1}, "rack_cols is 1; valid: at least 2"),
        (
            {"pick": 50, "sides": "nesw"},
            "pick is 50; valid: at most 17, the docks that fit along 20 rows and 40 column",
        ),
        ({"pick": 30, "drop": 9, "islands": True}, "29 stations between the racks, 25 pick and 4 drop; valid: at most"),
    ],
)
def test_what_cannot_be_is_refused_with_what_fits(change, message):
    with pytest.raises(PlanError, match=message):
        generate_warehouse(**({"rows": 20, "cols": 40, "pick": 1, "drop": 1, "parking": 4} | change))


def test_as_many_islands_as_the_message_names_fit():
    numbers = {"rows": 30, "cols": 40, "drop": 1, "parking": 10, "sides": "none", "islands": True}
    with pytest.raises(PlanError, match="between the racks") as refused:
        generate_warehouse(**numbers, pick=1000)
    fit = int(str(refused.value).split("at most ")[1].split(",")[0])
    site = generate_warehouse(**numbers, pick=fit - 1)
    assert len(site.stations) == fit
    assert check_site(site).warnings == ()


def test_a_floor_for_ten_thousand_cars():
    site = generate_warehouse(
        rows=300, cols=600, pick=500, drop=500, parking=10_000, sides="none", islands=True, name="ten_thousand"
    )
    assert len(site.parking) == 10_000
    assert site.cut_cells == ()
    report = check_site(site)
    assert report.warnings == ()
    assert report.path_ratio <= 1.5
