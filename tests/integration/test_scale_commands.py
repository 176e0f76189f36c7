"""The gap, fit and capacity commands, each run for real and small."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import pytest

from fleet.cli.main import main


def called(*words: str) -> None:
    with pytest.raises(SystemExit) as stop:
        main(list(words))
    assert stop.value.code == 0


def test_two_fidelities_on_the_same_orders(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = "cell --robots 1 --seeds 2 --duration 90 --rate 200 --fidelities kinematic,grid"
    called("gap", *words.split(), "--jobs", "2", "--out", str(tmp_path / "a"))
    said = capsys.readouterr().out
    for word in (
        "arrival at a dock [s]",
        "deliveries [1/h]",
        "service at a dock [s]",
        "waiting",
        "contacts between robots: 0",
    ):
        assert word in said
    lines = list(csv.DictReader((tmp_path / "a" / "gap.csv").read_text().splitlines()))
    assert [(line["fidelity"], line["seed"]) for line in lines] == [
        (fidelity, seed) for fidelity in ("kinematic", "grid") for seed in ("0", "1")
    ]
    assert all(int(line["tasks_done"]) >= 1 for line in lines)
    whole = json.loads((tmp_path / "a" / "gap.json").read_text())
    assert whole["reference"] == "kinematic"
    arrival = whole["gaps"][0]
    assert (arrival["figure"], arrival["fidelity"]) == ("arrival at a dock [s]", "grid")
    assert 0.0 < abs(arrival["difference"]["mean"]) < 10.0
    # Runs do not depend on the number of processes.
    called("gap", *words.split(), "--jobs", "1", "--out", str(tmp_path / "b"))
    assert (tmp_path / "b" / "gap.csv").read_bytes() == (tmp_path / "a" / "gap.csv").read_bytes()


@pytest.mark.bullet
@pytest.mark.slow
def test_physics_is_the_reference_and_tells_slip(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = "small --robots 2 --seeds 1 --duration 60 --fidelities kinematic,physics"
    called("gap", *words.split(), "--out", str(tmp_path))
    said = capsys.readouterr().out
    assert "physics: contacts between robots: 0, with walls and shelves: 0; worst slip in a grip" in said
    whole = json.loads((tmp_path / "gap.json").read_text())
    assert {gap["fidelity"] for gap in whole["gaps"]} == {"kinematic"}
    # Both have the same way to the same dock: a fraction of a second apart.
    drive = next(gap for gap in whole["gaps"] if gap["figure"].startswith("drive"))
    assert abs(drive["share"]["mean"]) < 0.1


@pytest.mark.bullet
def test_the_fit_finds_the_same_car_again(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = ("fit", "--site", "cell", "--robots", "1", "--duration", "12")
    called(*words, "--out", str(tmp_path / "a.json"))
    said = capsys.readouterr().out
    assert "max_steering_rate_radps" in said
    assert "place 1 s ahead [m]" in said
    found = json.loads((tmp_path / "a.json").read_text())
    fitted, today = found["steps"]["model"], found["today"]
    assert fitted["wheelbase_m"] == pytest.approx(today["wheelbase_m"], rel=0.05)
    assert fitted["max_steering_rate_radps"] == pytest.approx(today["max_steering_rate_radps"], rel=0.1)
    assert fitted["max_accel_mps2"] > today["max_accel_mps2"]
    assert 0.0 < fitted["steering_lag_s"] < 0.1
    steps = next(one for one in found["checked"] if one["drive"] == "steps of steering")
    assert steps["fitted"]["steering_rad"] < steps["today"]["steering_rad"]
    called(*words, "--out", str(tmp_path / "b.json"))
    assert (tmp_path / "b.json").read_bytes() == (tmp_path / "a.json").read_bytes()


def test_abstract_runs_deliver_what_whole_ones_do(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = "small --robots 6 --seeds 2 --duration 600 --fidelities kinematic,abstract"
    called("gap", *words.split(), "--out", str(tmp_path))
    assert "abstract: contacts between robots: 0" in capsys.readouterr().out
    gaps = {gap["figure"]: gap for gap in json.loads((tmp_path / "gap.json").read_text())["gaps"]}
    assert abs(gaps["deliveries [1/h]"]["share"]["mean"]) < 0.06
    assert abs(gaps["drive to the drop dock [s]"]["difference"]["mean"]) < 4.0
    assert abs(gaps["arrival at a dock [s]"]["share"]["mean"]) < 0.25
    assert abs(gaps["service at a dock [s]"]["difference"]["mean"]) < 0.3


@pytest.mark.parametrize("fidelity", ["grid", "abstract"])
def test_a_small_capacity(fidelity: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    called("capacity", "--robots", "1,2", "--fidelities", fidelity, "--minutes", "0.7", "--out", str(tmp_path))
    said = capsys.readouterr().out
    assert "real-time factor" in said
    cells = json.loads((tmp_path / "capacity.json").read_text())["cells"]
    assert [cell["robots"] for cell in cells] == [1, 2]
    for cell in cells:  # a slow machine may have had no time, and says so
        assert bool(cell["why"]) is (cell["first_move_s"] is None)
        assert cell["why"] or cell["memory_mb"] > 20.0


def test_what_abstract_runs_do_not_know_is_refused_before_the_others_begin(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The slowest runs were done first, and then lost."""
    orders = tmp_path / "orders.csv"
    orders.write_text(
        "id,release_s,pick,drop,mass_kg,size_m,after\na,0,pick_1,drop_1,0.3,0.06,\nb,0,pick_1,drop_1,0.3,0.06,a\n"
    )
    for words, complaint in (
        (["small", "--orders", str(orders)], "order b is not one that abstract runs know"),
        (["two_way"], "--site is 'two_way, where cars may reverse'; valid: a site with lanes of one way"),
    ):
        with pytest.raises(SystemExit) as stop:
            main(["gap", *words, "--fidelities", "kinematic,abstract", "--out", str(tmp_path / "out")])
        assert stop.value.code == 2
        said = capsys.readouterr()
        assert complaint in said.err
        assert "runs done" not in said.out
