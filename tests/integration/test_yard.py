"""The yard in physics: cars on wheels deliver over a floor without lanes, and touch nothing."""

import json
from pathlib import Path

import pytest

from fleet.cli.main import main

pytestmark = pytest.mark.bullet


def test_a_yard_in_physics(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as stop:
        main(["yard", "demo", "--cars", "8", "--duration", "40", "--json", str(tmp_path / "out.json")])
    assert stop.value.code == 0
    result = json.loads((tmp_path / "out.json").read_text(encoding="utf-8"))
    assert (result["duration_s"], result["contacts"]) == (pytest.approx(40.0, abs=0.1), 0)
    assert result["deliveries"] >= 3
    assert result["min_clearance_m"] > 0.03
    assert result["longest_still_s"] < 15.0
    assert len(result["plan_s"]) == result["plans"]
    rows = [line.strip("│ ").split("│") for line in capsys.readouterr().out.splitlines() if line.startswith("│")]
    assert {name.strip(): value.strip() for name, value in rows}["deliveries"] == str(result["deliveries"])


def test_a_car_alone_is_near_nobody(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = ["--cars", "1", "--duration", "2", "--fidelity", "kinematic", "--json", str(tmp_path / "out.json")]
    with pytest.raises(SystemExit):
        main(["yard", "demo", *words])
    assert "Infinity" not in (tmp_path / "out.json").read_text(encoding="utf-8")
    assert json.loads((tmp_path / "out.json").read_text(encoding="utf-8"))["min_clearance_m"] is None
    assert "inf" not in capsys.readouterr().out
