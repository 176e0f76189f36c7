import dataclasses
import errno
import math
from pathlib import Path

import numpy as np
import pytest

from maps.errors import LaneError, MapsError, PlanError, SiteError, SiteFileError, StationError, UnknownSiteError
from maps.report import check_site, draw_site
from maps.site import load_site, outline, save_site, site_from_plan, site_names
from maps.stations import StationOptions

PLAN = ("_.........._", "AP..KKCK..DA", "_.........._", "#..........#")


def changed(row, col, character, plan=PLAN):
    lines = [list(line) for line in plan]
    lines[row][col] = character
    return ["".join(line) for line in lines]


def test_default_station_by_hand():
    site = site_from_plan(PLAN, name="s")
    pick, drop = site.stations
    assert (pick.name, pick.kind, drop.name, drop.kind) == ("pick_1", "pick", "drop_1", "drop")
    # The pick dock is cell (1, 1), centre (1.5, 2.5); the arm stands 0.6 m west of the tray and looks east.
    assert pick.dock.tray_xy == pytest.approx((1.5, 2.5))
    assert pick.arm.pose == pytest.approx((0.9, 2.5, 0.0, 0.0))
    assert drop.arm.pose == pytest.approx((11.1, 2.5, 0.0, math.pi))
    assert pick.slots.shape == (4, 3)
    angle = np.degrees(np.arctan2(pick.slots[:, 1] - 2.5, pick.slots[:, 0] - 0.9))
    np.testing.assert_allclose(sorted(angle), [-155, -115, 115, 155])
    np.testing.assert_allclose(np.hypot(pick.slots[:, 0] - 0.9, pick.slots[:, 1] - 2.5), 0.45)
    np.testing.assert_allclose(pick.pedestal_half_m, [[0.08, 0.08, 0.125]] * 4)
    # Slots of the drop arm are those of the pick arm turned by half a turn.
    np.testing.assert_allclose(drop.slots[:, :2] - (11.1, 2.5), -(pick.slots[:, :2] - (0.9, 2.5)), atol=1e-12)


def test_options_move_dock_arm_and_slots():
    options = {
        "pick_1": StationOptions(
            stop_offset_m=0.2, arm_xy=(0.9, 2.5), arm_yaw_deg=10.0, slots=((-0.4, 0.0, 0.3), (0.0, 0.4, 0.2))
        )
    }
    site = site_from_plan(PLAN, name="s", options=options)
    pick = site.station("pick_1")
    assert pick.dock.stop_offset_m == 0.2
    assert pick.arm.pose == pytest.approx((0.9, 2.5, 0.0, math.radians(10)))
    expected = (0.9 - 0.4 * math.cos(math.radians(10)), 2.5 - 0.4 * math.sin(math.radians(10)), 0.3)
    np.testing.assert_allclose(pick.slots[0], expected)
    assert pick.pedestal_half_m[:, 2].tolist() == [0.15, 0.1]


def test_saved_site_reads_back_equal(tmp_path):
    options = {"drop_1": StationOptions(stop_offset_m=0.22, slots=((-0.4, 0.0, 0.25),))}
    site = site_from_plan(PLAN, name='an "odd" name', allow_reverse=True, options=options)
    save_site(site, tmp_path / "site.toml")
    again = load_site(tmp_path / "site.toml")
    assert again == site
    assert again != site_from_plan(PLAN, name='an "odd" name', allow_reverse=True)
    assert [path.name for path in tmp_path.iterdir()] == ["site.toml"]


def test_unwritable_path_is_named(tmp_path):
    with pytest.raises(SiteFileError, match="cannot be written"):
        save_site(load_site("cell"), tmp_path / "no" / "site.toml")
    with pytest.raises(SiteFileError, match="valid: a file"):
        save_site(load_site("cell"), "")


def test_a_full_disk_leaves_no_part_of_a_site_file(tmp_path, monkeypatch):
    """Bad input of the first hour: a full disk left an empty `site.toml.part`, and the message named no cure."""

    def full(path: Path, *words: object, **more: object) -> int:
        path.touch()
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(Path, "write_text", full)
    with pytest.raises(SiteFileError, match=r"No space left on device; valid: .* room on its disk"):
        save_site(load_site("cell"), tmp_path / "site.toml")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("name", site_names())
def test_the_outline_of_a_site_is_that_of_the_whole_site(name):
    site, found = load_site(name), outline(name)
    assert (found.name, found.rows, found.cols) == (site.name, site.grid.rows, site.grid.cols)
    assert (found.n_pick, found.n_drop) == (len(site.station_names("pick")), len(site.station_names("drop")))
    assert found.n_parking == len(site.parking)


def test_unknown_site_lists_the_names():
    """A friction of the first hour: `smal` got no 'did you mean'."""
    with pytest.raises(
        UnknownSiteError, match=rf"'smal' is unknown \(did you mean small\?\).*{', '.join(site_names())}"
    ):
        load_site("smal")


def test_a_folder_is_told_from_a_name(tmp_path):
    with pytest.raises(UnknownSiteError, match=r"is a folder; valid: one of .* or a path to a site file"):
        load_site(tmp_path)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("plan = [", "is no TOML"),
        ("name = 'a'", "plan is missing"),
        ("palns = 'x'", "palns is not a known entry (did you mean plan?)"),
        (
            "plan = '''\n.\n'''\ncolour = 1",
            "colour is not a known entry; valid: one of name, allow_reverse, cell_m, plan",
        ),
        ("plan = '.'\n[stations.pick_1]\narm = 1", "stations.pick_1.arm is 1"),
        ("plan = '.'\n[stations.pick_1]\nstop_offset_m = -0.1", "stations.pick_1.stop_offset_m is -0.1"),
        ("plan = '.'\n[stations.pick_1]\narm_xy = [nan, 1.0]", "arm_xy"),
        ("plan = ''", "plan is empty"),
        ("plan = '''\nP.\nD\n'''", "row 1 has 1 characters; valid: 2"),
        ("plan = '''\nP.\nDz\n'''", "row 1, column 1: unknown character 'z'; valid: one of"),
        ("plan = '''\nP.\n..\n'''", "no drop dock"),
    ],
)
def test_malformed_file_is_one_clear_line(tmp_path, text, message):
    """A friction of the first hour: `palns = ...` was told as 'plan is missing', without the unknown name."""
    path = tmp_path / "bad.toml"
    path.write_text(text)
    with pytest.raises(SiteError) as caught:
        load_site(path)
    assert message in str(caught.value)
    assert "bad.toml" in str(caught.value)
    assert "\n" not in str(caught.value)
    assert isinstance(caught.value, MapsError)


def test_undecodable_file_is_refused(tmp_path):
    path = tmp_path / "bad.toml"
    path.write_bytes(b"\xff\xfe\x00")
    with pytest.raises(SiteFileError, match="line 1: byte 0xff is no text in UTF-8; valid: "):
        load_site(path)


@pytest.mark.parametrize(
    ("plan", "error", "message"),
    [
        (changed(1, 0, "#"), StationError, "pick_1 at row 1, column 1 has 0 arms beside it"),
        (
            changed(0, 1, "A"),
            StationError,
            "pick_1 at row 1, column 1 has 2 arms beside it; valid: one 'A', or",
        ),
        (changed(3, 0, "A"), StationError, "arm at row 3, column 0 has no dock beside it"),
        (["_#....._", "AP....DA", "......._", "#......#"], StationError, "stands on the lane cell"),
        (["_......_", "AP....DA", "_......_", "###..###", "###K####"], LaneError, "parking cell at row 4, column 3"),
        (["_......_", "AP....DA", "_......_", "###.####", "###C.###"], LaneError, "charger cell at row 4, column 3"),
        (
            ["_......_", "AP.....#", "_......_", "#######_", "#....#DA"],
            LaneError,
            "drop_1 at row 4, column 6 is a dead end",
        ),
        (["_......_", "AP....DA", "_.....DA", "_......_"], StationError, "1.48 m apart; valid: at least 2.0 m"),
        (["_....._", "AP...DA", "_......."], PlanError, "row 2 has 8 characters; valid: 7"),
        (changed(1, 3, "x"), PlanError, "'x' at row 1, column 3 without allow_reverse = true"),
    ],
)
def test_plan_that_cannot_work_is_refused(plan, error, message):
    """A friction of the first hour: rows and columns of a plan counted from 1, those of all else from 0."""
    with pytest.raises(error) as caught:
        site_from_plan(plan, name="s")
    assert message in str(caught.value)


def test_a_dock_with_two_arms_is_two_stations():
    site = load_site("twin")
    assert [station.name for station in site.stations] == ["pick_1", "pick_2", "drop_1", "drop_2"]
    first, second = site.stations[:2]
    assert first.dock == second.dock
    tray = np.array(first.dock.tray_xy)
    to_arm = [np.array(station.arm.pose[:2]) - tray for station in (first, second)]
    np.testing.assert_allclose(to_arm[0], -to_arm[1])
    np.testing.assert_allclose(np.linalg.norm(to_arm, axis=1), 0.6)


def test_both_arms_of_a_dock_want_the_car_at_one_place():
    plan = load_site("twin").plan
    with pytest.raises(StationError, match=r"pick_1\.stop_offset_m is 0\.1 and stations\.pick_2"):
        site_from_plan(plan, name="s", options={"pick_1": StationOptions(stop_offset_m=0.1)})


@pytest.mark.parametrize(
    ("given", "message"),
    [
        (StationOptions(arm_xy=(0.5, 2.5)), "cannot serve the tray of a docked car"),
        (StationOptions(slots=((-0.7, 0.0, 0.25),)), "cannot serve slot 1"),
        (StationOptions(slots=((0.0, -0.2, 0.25),)), "cannot serve slot 1"),
        (StationOptions(slots=((0.5, 0.0, 0.25),)), "slot 1 at (1.40, 2.50) m stands on the lane cell row 1, column 1"),
        (StationOptions(slots=()), "valid: at least one [x, y, z]"),
        (StationOptions(stop_offset_m=0.6), "valid: 0 to 0.35"),
    ],
)
def test_arm_that_cannot_reach_is_refused(given, message):
    with pytest.raises(StationError) as caught:
        site_from_plan(PLAN, name="s", options={"pick_1": given})
    assert message in str(caught.value)
    assert "pick_1" in str(caught.value)


def test_option_for_a_station_that_is_not_there():
    with pytest.raises(StationError, match=r"stations.pick_7 is not in the plan; valid: one of pick_1, drop_1"):
        site_from_plan(PLAN, name="s", options={"pick_7": StationOptions()})
    with pytest.raises(LaneError, match="valid: one of pick_1, drop_1"):
        site_from_plan(PLAN, name="s").station("pick_7")


def test_two_way_cells_need_a_passing_place():
    corridor = ["_.........._", "AP########DA", "_.###xx###._", "#...#xx#...#", "#..........#"]
    assert site_from_plan(corridor, name="s", allow_reverse=True).allow_reverse
    tight = ["_..........._", "AP####x####DA", "_.####x####._", "#...........#"]
    with pytest.raises(PlanError, match="has no passing place"):
        site_from_plan(tight, name="s", allow_reverse=True)


def test_stations_are_named_in_reading_order():
    names = {station.name: station.dock.cell for station in load_site("medium").stations}
    assert list(names) == [f"pick_{i}" for i in range(1, 7)] + [f"drop_{i}" for i in range(1, 7)]
    picks = [names[f"pick_{i}"] for i in range(1, 7)]
    assert picks == sorted(picks)


def test_report_warns_of_a_dock_in_the_only_lane_and_of_cut_floor():
    """A friction of the first hour: `1 other places`."""
    report = check_site(
        site_from_plan(["_........_", "AP#####.DA", "_.######._", "#........#", "####.#####"], name="s")
    )
    assert report.cut_cells == ((1, 7), (4, 4))
    assert any("2 floor cells are cut off" in line for line in report.warnings)
    assert any("no parking" in line for line in report.warnings)
    assert any(line == "pick_1: a car in the dock blocks the only lane to 1 other place" for line in report.warnings)
    assert (report.picks, report.drops, report.parking, report.lanes) == (1, 1, 0, 20)


def test_drawing_shows_every_lane_once():
    site = load_site("cell")
    drawing = draw_site(site)
    assert sum(drawing.count(arrow) for arrow in "<>^v") == len(site.lanes)
    assert len(drawing.splitlines()) == 1 + 2 * site.grid.rows - 1


def test_drawing_tells_rows_columns_and_stations() -> None:
    """A friction of the first hour: cells that messages name could not be found in the drawing."""
    site = load_site("small")
    heading, *lines = draw_site(site).splitlines()
    for station in site.stations:
        row, col = site.grid.row_col(station.dock.cell)
        line = lines[2 * row]
        assert line.split()[0] == str(row)
        assert station.name in line
        place = len(str(site.grid.rows - 1)) + 2 + 2 * col
        assert line[place] in "PD"
        assert heading.index("10", 5) == len(str(site.grid.rows - 1)) + 2 + 20


def test_a_name_with_any_character_comes_back(tmp_path: Path) -> None:
    """Those beyond the first 65,536 were written as two halves, which TOML does not have."""
    site = dataclasses.replace(load_site("cell"), name='Lager \U0001f4e6 \x7f "1"')
    save_site(site, tmp_path / "lager.toml")
    assert load_site(tmp_path / "lager.toml").name == site.name
