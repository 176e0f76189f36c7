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
