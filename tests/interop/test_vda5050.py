"""VDA 5050 with partners of two houses: their masters order our cars and arms, our master orders their vehicles."""

import json
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("paho", reason="MQTT needs the extra vda5050")

from benchmarks.interop.brokers import broker
from fleet.cli.main import main
from fleet.config import Fidelity, RunConfig
from fleet.run.setup import RunSetup
from tests.interop.conftest import SCRIPTS, Process, require_partner
from tests.interop.ear import Ear
from tests.interop.hall import driven, serving
from tests.interop.table import FOLDER, PARTNERS, SDK

LIB = {"NODE_PATH": str(FOLDER / "vda-5050-lib" / "node_modules")}
DIALECTS = {"vda-5050-lib": "2.0.0-coaty", "vda5050-sdk": "2.1.0"}
CASES = [
    pytest.param(partner, kind, marks=[pytest.mark.interop(partner), pytest.mark.interop(kind)])
    for partner, kind in (("vda-5050-lib", "amqtt"), ("vda-5050-lib", "mosquitto"), ("vda5050-sdk", "mosquitto"))
]


@pytest.fixture
def started() -> Iterator[list[Process]]:
    """Yield a list of programs that are ended with the test."""
    made: list[Process] = []
    yield made
    for process in made:
        process.end()


def need(partner: str, kind: str) -> None:
    """Skip what cannot be run."""
    for name in (partner, kind):
        if name in PARTNERS:
            require_partner(name)


def master(partner: str, url: str, folder: Path, site: str, cars: int, orders: int) -> Process:
    """Start a foreign master that has parcels delivered."""
    layout = folder / "site.lif.json"
    with pytest.raises(SystemExit):
        main(["site", "export", site, str(layout)])
    if partner == "vda-5050-lib":
        words = ["node", str(SCRIPTS / "vda_5050_lib_master.js"), url, str(layout), str(cars), str(orders)]
        return Process(words, LIB | {"MAP_ID": site})
    words = [
        str(SDK / "bin" / "python"),
        str(SCRIPTS / "sdk_master.py"),
        url,
        str(layout),
        site,
        str(cars),
        str(orders),
    ]
    return Process(words, {})


def vehicles(partner: str, url: str, site: str, poses: list[list[float]]) -> Process:
    """Start foreign vehicles at some places, whose time goes five times as fast."""
    if partner == "vda-5050-lib":
        return Process(["node", str(SCRIPTS / "vda_5050_lib_agvs.js"), url, site, "5", json.dumps(poses)], LIB)
    words = [str(SDK / "bin" / "python"), str(SCRIPTS / "sdk_vehicles.py"), url, site, "0.2", json.dumps(poses)]
    return Process(words, {})


def check(partner: str, told: dict[str, Any], result: dict[str, Any], orders: int) -> None:
    """All is done, nobody has complained, and nothing has touched anything."""
    assert told["processed"] == orders
    assert told["errors"] == []
    if partner == "vda-5050-lib":
        assert (told["picked"], told["dropped"], told["traversed"]) == (orders, orders, 4 * orders)
        assert (told["invalid"], told["cancelled"]) == (0, 0), told.get("lastInvalid")
    else:
        assert told["finished"] == 2 * orders
    assert (result["robot_contacts"], result["static_contacts"]) == (0, 0)
    assert result["tasks_done"] == orders


@pytest.mark.parametrize(("partner", "kind"), CASES)
def test_a_foreign_master_has_all_its_orders_done(
    partner: str, kind: str, tmp_path: Path, started: list[Process]
) -> None:
    """Rows V1 and V3, small."""
    need(partner, kind)
    words = ("--site", "small", "--robots", "3", "--fidelity", "kinematic", "--speed", "0")
    with broker(kind) as url, serving(url, tmp_path / "run", "--dialect", DIALECTS[partner], *words) as hall:
        started.append(master(partner, url, tmp_path, "small", 3, 6))
        told = json.loads(started[0].line("result", hall.runs))
    check(partner, told, hall.result, 6)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("partner", "orders"),
    [
        pytest.param("vda-5050-lib", 40, marks=pytest.mark.interop("vda-5050-lib")),
        pytest.param("vda5050-sdk", 20, marks=pytest.mark.interop("vda5050-sdk")),
    ],
)
def test_eight_cars_on_their_wheels_do_all_orders(
    partner: str, orders: int, tmp_path: Path, started: list[Process]
) -> None:
    """Rows V1 and V3."""
    need(partner, "amqtt")
    words = ("--site", "medium", "--robots", "8", "--fidelity", "physics", "--speed", "0")
    with broker("amqtt") as url, serving(url, tmp_path / "run", "--dialect", DIALECTS[partner], *words) as hall:
        started.append(master(partner, url, tmp_path, "medium", 8, orders))
        told = json.loads(started[0].line("result", hall.runs))
    check(partner, told, hall.result, orders)


@pytest.mark.parametrize(
    ("partner", "site", "n", "tasks"),
    [
        pytest.param("vda-5050-lib", "small", 3, 6, marks=pytest.mark.interop("vda-5050-lib")),
        pytest.param("vda5050-sdk", "small", 3, 6, marks=pytest.mark.interop("vda5050-sdk")),
        pytest.param("vda-5050-lib", "dense", 20, 40, marks=[pytest.mark.interop("vda-5050-lib"), pytest.mark.slow]),
        pytest.param("vda5050-sdk", "dense", 20, 20, marks=[pytest.mark.interop("vda5050-sdk"), pytest.mark.slow]),
    ],
)
def test_our_master_has_foreign_vehicles_bring_parcels(
    partner: str, site: str, n: int, tasks: int, tmp_path: Path, started: list[Process]
) -> None:
    """Rows V2 and V3: all orders are done, no two vehicles say that they are in one cell, and each node takes at most
    one update."""
    need(partner, "amqtt")
    setup = RunSetup.of(RunConfig(site=site, robots=n, fidelity=Fidelity.GRID))
    poses = [[x, y, math.remainder(yaw, math.tau)] for x, y, yaw in setup.graph.state_pose[setup.start_states].tolist()]
    words = ["--dialect", DIALECTS[partner], "--site", site, "--tasks", str(tasks), "--speed", "5"]
    words += [word for k in range(n) for word in ("--vehicle", f"acme/agv_{k}")]
    with broker("amqtt") as url, Ear(url) as ear:
        started.append(vehicles(partner, url, site, poses))
        started[0].line("ready")
        result = driven(url, tmp_path / "run", *words)
    assert (result["tasks_done"], result["tasks_failed"]) == (tasks, 0)
    assert (ear.errors, ear.together) == ([], [])
    assert len(ear.cell_of) == n
    for serial, orders in ear.orders.items():
        n_begun = len({order for order, _ in orders})
        assert len(orders) <= len(ear.nodes[serial]) - n_begun, serial
