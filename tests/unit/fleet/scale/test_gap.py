"""Differences of fidelities on rows made by hand."""

from __future__ import annotations

import csv
import json
import math
from dataclasses import replace
from pathlib import Path

import pytest

from fleet.config import Fidelity
from fleet.errors import ConfigError
from fleet.scale.gap import (
    ARRIVAL,
    CSV_FILE,
    JSON_FILE,
    WAITING,
    Gap,
    find_gaps,
    gap_plot,
    safety_sentences,
    write_gap,
)
from fleet.scale.gap_run import GapDesign, GapRow

DESIGN = GapDesign(
    site="small",
    robots=2,
    seeds=(0, 1),
    fidelities=(Fidelity.KINEMATIC, Fidelity.PHYSICS),
    duration_s=60.0,
    stream=None,
)
ROW = GapRow(
    fidelity="physics",
    seed=0,
    tasks_done=10,
    tasks_failed=0,
    throughput_per_h=100.0,
    task_time_s=50.0,
    drive_s=20.0,
    service_s=4.0,
    waiting_share=0.10,
    robot_contacts=0,
    static_contacts=0,
    slip_max_m=0.0004,
    stalled=False,
    state_hash="a",
    arrivals_s={"t_0 pick": 10.0, "t_0 drop": 30.0},
)
ROWS = [
    ROW,
    replace(ROW, seed=1, throughput_per_h=200.0, task_time_s=None, robot_contacts=2, slip_max_m=0.0021),
    replace(
        ROW,
        fidelity="kinematic",
        throughput_per_h=104.0,
        waiting_share=0.13,
        slip_max_m=None,
        arrivals_s={"t_0 pick": 11.0, "t_0 drop": 32.0, "t_1 pick": 500.0},
    ),
    replace(
        ROW, fidelity="kinematic", seed=1, throughput_per_h=206.0, waiting_share=0.13, slip_max_m=None, arrivals_s={}
    ),
]


def gap(figure: str) -> Gap:
    return next(one for one in find_gaps(ROWS, "physics", ["kinematic"]) if one.figure == figure)


def test_differences_are_paired_by_seed() -> None:
    found = gap("deliveries [1/h]")
    assert (found.value.mean, found.reference.mean, found.difference.mean) == (155.0, 150.0, 5.0)
    # Differences 4 and 6: t(0.975, 1) = 12.706, standard deviation 1.4142.
    assert found.difference.half_width == pytest.approx(12.706, rel=1e-3)
    assert found.share is not None
    assert found.share.mean == pytest.approx(5.0 / 150.0)
    assert found.share.half_width == pytest.approx(found.difference.half_width / 150.0)


def test_arrivals_are_compared_over_the_orders_of_both() -> None:
    found = gap(ARRIVAL)
    # The order that came in one run alone, and the seed without any, say nothing.
    assert (found.value.mean, found.reference.mean, found.difference.mean) == (21.5, 20.0, 1.5)
    assert (found.difference.n, found.difference.half_width) == (1, math.inf)


def test_waiting_is_a_share_of_the_time_and_not_of_itself() -> None:
    found = gap(WAITING)
    assert found.difference.mean == pytest.approx(3.0)
    assert found.share is not None
    assert found.share.mean == pytest.approx(0.03)


def test_a_figure_that_one_of_a_pair_lacks_leaves_that_seed_out() -> None:
    assert gap("task time [s]").difference.n == 1


def test_a_reference_of_zero_has_no_share_and_no_runs_no_gaps() -> None:
    rows = [replace(row, throughput_per_h=0.0) for row in ROWS]
    found = [one for one in find_gaps(rows, "physics", ["kinematic"]) if one.figure == "deliveries [1/h]"]
    assert [one.share for one in found] == [None]
    assert find_gaps(ROWS[:2], "physics", ["kinematic"]) == ()


def test_contacts_and_slip_are_told_of_all_seeds() -> None:
    physics, kinematic = safety_sentences(ROWS, ["physics", "kinematic", "grid"])
    assert physics.startswith("physics: contacts between robots: 2, with walls and shelves: 0")
    assert "2.10 mm" in physics
    assert "slip is not measured" in kinematic
    stands = safety_sentences([replace(ROW, stalled=True)], ["physics"])
    assert stands[-1] == "physics: 1 run came to a stand."


def test_the_reference_is_physics_wherever_it_stands() -> None:
    assert (DESIGN.reference, DESIGN.others) == (Fidelity.PHYSICS, (Fidelity.KINEMATIC,))
    planar = replace(DESIGN, fidelities=(Fidelity.GRID, Fidelity.KINEMATIC))
    assert (planar.reference, planar.others) == (Fidelity.GRID, (Fidelity.KINEMATIC,))
    assert [(config.fidelity, config.seed) for config in DESIGN.configs] == [
        (Fidelity.PHYSICS, 0),
        (Fidelity.KINEMATIC, 0),
        (Fidelity.PHYSICS, 1),
        (Fidelity.KINEMATIC, 1),
    ]


@pytest.mark.parametrize("names", [(Fidelity.GRID,), (Fidelity.GRID, Fidelity.GRID)])
def test_one_fidelity_is_no_comparison(names: tuple[Fidelity, ...]) -> None:
    with pytest.raises(ConfigError, match=r"--fidelities is .*; valid: "):
        replace(DESIGN, fidelities=names)


def test_files_hold_the_runs_and_what_they_show(tmp_path: Path) -> None:
    gaps = find_gaps(ROWS, "physics", ["kinematic"])
    plot = gap_plot(gaps, "physics", ["kinematic"], "two cars")
    write_gap(tmp_path / "out", DESIGN, ROWS, gaps, plot)
    lines = list(csv.DictReader((tmp_path / "out" / CSV_FILE).read_text().splitlines()))
    assert [(line["fidelity"], line["seed"]) for line in lines] == [
        ("physics", "0"),
        ("physics", "1"),
        ("kinematic", "0"),
        ("kinematic", "1"),
    ]
    assert lines[2]["slip_max_m"] == ""
    whole = json.loads((tmp_path / "out" / JSON_FILE).read_text())
    assert (whole["reference"], len(whole["gaps"]), len(whole["runs"])) == ("physics", len(gaps), 4)
    assert whole["gaps"][0]["difference"]["half_width"] is None  # infinite
    assert (tmp_path / "out" / "gap.png").read_bytes()[:4] == b"\x89PNG"
    assert (tmp_path / "out" / "gap.svg").read_text().count("<circle") == len(gaps) + 1  # and the legend
