"""Floors of others, imported by the command, are driven on: parcels arrive, and nothing touches."""

import json
from pathlib import Path

import pytest

from fleet.cli.main import main
from fleet.config import ArmConfig, Fidelity, RunConfig
from fleet.simulation import Simulation

CROOKED = {
    "in": (0.0, 0.0),
    "a": (7.3, -2.1),
    "b": (13.8, 1.4),
    "out": (14.9, 7.7),
    "c": (8.2, 11.6),
    "park": (3.1, 6.4),
    "d": (-2.4, 4.9),
}
WAYS = ["in a", "a b", "b out", "out c", "c d", "d in", "a park", "park c", "c b"]


def lif(nodes: dict[str, tuple[float, float]], ways: list[str], stations: dict[str, str]) -> str:
    """A layout of another hand: nodes anywhere, no headings, no curves."""
    of_vehicle = [{"vehicleTypeId": "truck"}]
    layout = {
        "layoutId": "hall",
        "layoutVersion": "3",
        "nodes": [
            {"nodeId": name, "nodePosition": {"x": x, "y": y}, "vehicleTypeNodeProperties": of_vehicle}
            for name, (x, y) in nodes.items()
        ],
        "edges": [
            {"edgeId": way, "startNodeId": start, "endNodeId": end, "vehicleTypeEdgeProperties": of_vehicle}
            for way in ways
            for start, end in [way.split()]
        ],
        "stations": [
            {"stationId": name, "interactionNodeIds": [node], "stationDescription": name.split("_")[0]}
            for name, node in stations.items()
        ],
    }
    meta = {"projectIdentification": "hall", "creator": "x", "exportTimestamp": "2026-01-01T00:00:00Z"}
    return json.dumps({"metaInformation": meta | {"lifVersion": "1.0.0"}, "layouts": [layout]})


def run(*words: str) -> None:
    with pytest.raises(SystemExit) as stop:
        main(list(words))
    assert stop.value.code == 0


def deliver(site: Path, robots: int, tasks: int) -> None:
    config = RunConfig(
        site=str(site),
        robots=robots,
        tasks=tasks,
        fidelity=Fidelity.KINEMATIC,
        duration_s=900.0,
        arms=ArmConfig(workers_n=0),
    )
    with Simulation(config) as simulation:
        while not simulation.finished:
            simulation.tick()
        result = simulation.summary()
    assert (result.tasks_done, result.robot_contacts, result.static_contacts) == (tasks, 0, 0)


def test_a_site_that_was_elsewhere_is_driven_on(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file, back = tmp_path / "cell.xml", tmp_path / "back.toml"
    run("site", "export", "cell", str(file))
    run("site", "import", str(file), "--out", str(back), "--grip", "suction")
    said = capsys.readouterr().out
    assert "back.toml: 12 x 8 m, 2 stations\npath ratio 1.39\n" in said
    assert "note:" not in said
    deliver(back, robots=2, tasks=3)


def test_a_floor_on_no_grid_is_drawn_anew_and_driven_on(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file, out = tmp_path / "hall.lif", tmp_path / "hall.toml"
    stations = {"pick_gate": "in", "drop_gate": "out", "parking_1": "park"}
    file.write_text(lif(CROOKED, WAYS, stations), encoding="utf-8")
    with pytest.raises(SystemExit) as stop:
        main(["site", "import", str(file), "--out", str(out)])
    assert stop.value.code == 2
    assert "(--redraw)" in capsys.readouterr().err
    assert not out.exists()
    run("site", "import", str(file), "--out", str(out), "--redraw", "--grip", "suction")
    said = capsys.readouterr().out
    assert "pick_1: pick_gate\ndrop_1: drop_gate\n" in said
    assert "note: ways were drawn anew" in said
    deliver(out, robots=2, tasks=3)
