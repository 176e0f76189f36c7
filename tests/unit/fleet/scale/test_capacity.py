"""What is extrapolated, how the time is shared, and what is drawn and kept."""

from __future__ import annotations

import json
import time
from dataclasses import replace
from pathlib import Path

import pytest

from fleet.config import Fidelity
from fleet.scale.capacity import (
    JSON_FILE,
    CellKey,
    capacity_plots,
    complete,
    extrapolate,
    measure_capacity,
    time_share,
    write_capacity,
)
from fleet.scale.cell import CellFigures, measure_cell, peak_memory_mb
from fleet.scale.floors import floor_for, n_drop_stations
from fleet.stations.service_time import PRIOR_MEAN_S

GRID, KINEMATIC = Fidelity.GRID, Fidelity.KINEMATIC
CELL = CellFigures(
    real_time_factor=100.0,
    memory_mb=300.0,
    tasks_per_h=400.0,
    at_work_share=0.9,
    contacts=0,
    first_move_s=2.0,
    sim_s=900.0,
    core_share=1.0,
)
MEASURED: dict[CellKey, CellFigures] = {
    (10, GRID): CELL,
    (100, GRID): replace(CELL, real_time_factor=10.0, memory_mb=390.0, tasks_per_h=2000.0),
    (10, KINEMATIC): replace(CELL, tasks_per_h=None),
}


def test_a_power_law_is_continued() -> None:
    assert extrapolate({10: 2 * 10**-1.5, 100: 2 * 100**-1.5}, 10_000) == pytest.approx(2 * 10_000**-1.5)


def test_the_greatest_sizes_count_alone() -> None:
    assert extrapolate({1: 1e9, 10: 1000.0, 100: 100.0, 1000: 10.0, 3: None}, 10_000) == pytest.approx(1.0)


def test_a_line_is_continued_where_that_is_asked_for() -> None:
    assert extrapolate({10: 310.0, 100: 400.0}, 1000, power=False) == pytest.approx(1300.0)


@pytest.mark.parametrize("known", [{}, {10: 5.0}, {10: 5.0, 100: None}, {10: 5.0, 100: 0.0}])
def test_one_size_says_nothing_of_another(known: dict[int, float | None]) -> None:
    assert extrapolate(known, 1000) is None


def test_a_measured_cell_stays_as_it_was_measured() -> None:
    cell = complete((100, GRID), MEASURED, "")
    assert (cell.real_time_factor, cell.memory_mb, cell.tasks_per_h) == (10.0, 390.0, 2000.0)
    assert cell.extrapolated == ()


def test_a_cell_that_did_not_fit_is_continued_and_marked() -> None:
    cell = complete((1000, GRID), MEASURED, "did not start within 20 s")
    assert cell.real_time_factor == pytest.approx(1.0)
    assert cell.memory_mb == pytest.approx(1290.0)
    assert cell.tasks_per_h == pytest.approx(10_000.0)
    assert cell.extrapolated == ("real_time_factor", "memory_mb", "tasks_per_h")
    assert (cell.first_move_s, cell.why) == (None, "did not start within 20 s")


def test_a_fleet_that_was_held_up_does_not_bend_the_line() -> None:
    held_up = replace(MEASURED[100, GRID], real_time_factor=5.0, core_share=0.5)
    cell = complete((1000, GRID), MEASURED | {(100, GRID): held_up}, "no time was left")
    assert cell.real_time_factor == pytest.approx(0.75)  # 1 on a core of its own, of which there was 75 % on average


def test_deliveries_that_were_not_measured_are_those_of_another_fidelity() -> None:
    cell = complete((10, KINEMATIC), MEASURED, "")
    assert (cell.tasks_per_h, cell.extrapolated) == (400.0, ("tasks_per_h",))
    unknown = complete((100, KINEMATIC), MEASURED, "no time was left")
    assert (unknown.real_time_factor, unknown.memory_mb, unknown.tasks_per_h) == (None, None, 2000.0)


def test_deliveries_are_not_continued_beyond_what_the_arms_can_do() -> None:
    cell = complete((10_000_000, GRID), MEASURED, "no time was left")
    assert cell.tasks_per_h == pytest.approx(n_drop_stations(10_000_000) * 3600.0 / PRIOR_MEAN_S)


def test_large_fleets_get_more_of_the_time_and_failed_fidelities_none() -> None:
    cells = [(10, GRID), (10, KINEMATIC), (100, GRID), (100, KINEMATIC)]
    assert time_share(cells, {}) == pytest.approx(2 / 10)
    assert time_share(cells[2:], {(10, KINEMATIC): ""}) == 1.0


@pytest.mark.parametrize("n_cars", [1, 10, 100, 150])
def test_a_floor_has_a_bay_for_every_car(n_cars: int) -> None:
    site = floor_for(n_cars)
    assert len(site.parking) == n_cars
    assert len(site.stations) == 2 * n_drop_stations(n_cars)


def test_a_cell_is_measured_until_it_has_seen_enough(tmp_path: Path) -> None:
    floor = tmp_path / "floor.toml"
    found = measure_cell(3, GRID, floor, time.time() + 3600.0, most_sim_s=310.0)
    assert floor.is_file()
    assert found.sim_s == pytest.approx(310.0, abs=1.0)
    assert found.real_time_factor is not None
    assert found.real_time_factor > 0.0
    assert found.tasks_per_h is not None
    assert found.tasks_per_h > 0.0
    assert found.at_work_share > 0.5
    assert found.contacts == 0
    assert found.first_move_s > 0.0
    assert 20.0 < found.memory_mb <= peak_memory_mb()


def test_a_fleet_that_has_run_out_of_orders_is_not_measured_any_longer(tmp_path: Path) -> None:
    for fidelity in (GRID, Fidelity.ABSTRACT):
        found = measure_cell(3, fidelity, tmp_path / "floor.toml", time.time() + 3600.0, most_sim_s=310.0, n_orders=5)
        assert found.sim_s < 200.0
        assert found.tasks_per_h is None


def test_the_last_cell_has_all_of_the_time_that_is_left(monkeypatch: pytest.MonkeyPatch) -> None:
    found = MEASURED[10, GRID]
    given = []

    def told(n_cars: int, *words: object, **options: object) -> CellFigures:
        given.append((n_cars, options.get("n_orders")))
        return found

    monkeypatch.setattr("fleet.scale.capacity.run_cell", told)
    cells = measure_capacity([1, 2], [GRID], 1.0, interrupted=[], progress=lambda done, now: None)
    assert [cell.why for cell in cells] == ["", ""]
    assert given == [(1, None), (1, 312), (2, 324)]  # first the kernels


def test_a_cell_without_time_has_no_speed(tmp_path: Path) -> None:
    found = measure_cell(1, GRID, tmp_path / "floor.toml", time.time() - 1.0)
    assert (found.real_time_factor, found.tasks_per_h) == (None, None)


def test_an_interrupt_leaves_all_to_be_extrapolated() -> None:
    cells = measure_capacity([10, 100], [GRID], 1.0, interrupted=[2], progress=lambda done, now: None)
    assert [(cell.robots, cell.real_time_factor) for cell in cells] == [(10, None), (100, None)]
    assert [cell.why for cell in cells] == ["interrupted", "interrupted"]


def test_plots_tell_what_is_extrapolated(tmp_path: Path) -> None:
    cells = [complete((n, kind), MEASURED, "") for n in (10, 100, 1000) for kind in (GRID, KINEMATIC)]
    plots = capacity_plots(cells)
    assert list(plots) == ["real_time_factor", "memory_mb", "tasks_per_h"]
    speed = plots["real_time_factor"].svg()
    assert speed.count("(extrapolated)") == 2  # a ring is two dots
    assert "stroke-dasharray" in speed
    write_capacity(tmp_path / "out", cells, plots, 3.0)
    whole = json.loads((tmp_path / "out" / JSON_FILE).read_text())
    assert [cell["robots"] for cell in whole["cells"]] == [10, 10, 100, 100, 1000, 1000]
    assert whole["cells"][4]["extrapolated"] == ["real_time_factor", "memory_mb", "tasks_per_h"]
    assert (tmp_path / "out" / "memory_mb.png").is_file()


def test_nothing_known_draws_nothing() -> None:
    assert capacity_plots([complete((10, GRID), {}, "interrupted")]) == {}
