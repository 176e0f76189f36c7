"""vda-5050-lib in the dialect 2.0: its master orders our cars and arms, our master orders its virtual AGVs."""

import json
import os
import subprocess
import threading
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Self

import pytest

from benchmarks.interop.brokers import broker
from fleet.cli.main import main
from fleet.config import Fidelity, RunConfig
from fleet.run.setup import RunSetup
from tests.interop.conftest import SCRIPTS, Process, require_partner
from tests.interop.hall import EACH_BROKER, driven, serving
from tests.interop.table import FOLDER, PARTNERS

pytestmark = pytest.mark.interop("vda-5050-lib")
pytest.importorskip("paho", reason="MQTT needs the extra vda5050")
MODULES = {"NODE_PATH": str(FOLDER / "vda-5050-lib" / "node_modules")}
DIALECT = ("--dialect", "2.0.0-coaty")


@pytest.fixture(autouse=True)
def there() -> None:
    require_partner("vda-5050-lib")


def ordered(url: str, folder: Path, site: str, cars: int, orders: int, most_s: float) -> dict[str, Any]:
    """Let the foreign master have parcels delivered; returns what it has counted."""
    layout = folder / "site.lif.json"
    with pytest.raises(SystemExit):
        main(["site", "export", site, str(layout)])
    master = subprocess.run(
        ["node", str(SCRIPTS / "vda_5050_lib_master.js"), url, str(layout), str(cars), str(orders)],
        env=os.environ | MODULES | {"MAP_ID": site},
        capture_output=True,
        text=True,
        timeout=most_s,
        check=True,
    )
    told: dict[str, Any] = json.loads(master.stdout)
    return told


def check(told: dict[str, Any], result: dict[str, Any], orders: int) -> None:
    assert (told["processed"], told["picked"], told["dropped"]) == (orders, orders, orders)
    assert (told["errors"], told["invalid"], told["cancelled"]) == ([], 0, 0)
    assert told["traversed"] == 4 * orders
    assert (result["robot_contacts"], result["static_contacts"]) == (0, 0)
    assert result["tasks_done"] == orders


@pytest.mark.parametrize("kind", EACH_BROKER)
def test_a_foreign_master_has_all_its_orders_done(kind: str, tmp_path: Path) -> None:
    if kind in PARTNERS:
        require_partner(kind)
    words = (*DIALECT, "--site", "small", "--robots", "3", "--fidelity", "kinematic", "--speed", "0")
    with broker(kind) as url, serving(url, tmp_path / "run", *words) as result:
        told = ordered(url, tmp_path, "small", 3, 6, most_s=300.0)
    check(told, result, 6)


@pytest.mark.slow
def test_forty_orders_are_done_by_eight_cars_on_their_wheels(tmp_path: Path) -> None:
    """Row V1."""
    words = (*DIALECT, "--site", "medium", "--robots", "8", "--fidelity", "physics", "--speed", "0")
    with broker("amqtt") as url, serving(url, tmp_path / "run", *words) as result:
        told = ordered(url, tmp_path, "medium", 8, 40, most_s=3000.0)
    check(told, result, 40)


class Ear:
    """Hears what a master and its vehicles say to each other."""

    def __init__(self, url: str) -> None:
        from fleet.gateway.mqtt import BrokerAddress, MqttTransport

        patterns = [f"uagv/v2/acme/+/{topic}" for topic in ("state", "visualization", "order")]
        self._link = MqttTransport(BrokerAddress(url=url), "ear").link(patterns, None)
        self.cell_of: dict[str, tuple[int, int]] = {}
        self.together: list[tuple[str, str, tuple[int, int]]] = []
        """Pairs of vehicles whose newest places are in one cell."""
        self.orders: defaultdict[str, set[tuple[str, int]]] = defaultdict(set)
        self.nodes: defaultdict[str, set[tuple[str, int]]] = defaultdict(set)
        self.errors: list[str] = []
        self._ends = threading.Event()
        self._thread = threading.Thread(target=self._listen, daemon=True)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._ends.set()
        self._thread.join()
        self._link.close(None)

    def _listen(self) -> None:
        while not self._ends.wait(0.05):
            self._hear()

    def _hear(self) -> None:
        for topic, payload in self._link.received():
            serial, name = topic.split("/")[3:]
            body = json.loads(payload)
            if name == "order":
                self.orders[serial].add((body["orderId"], body["orderUpdateId"]))
                self.nodes[serial] |= {(body["orderId"], node["sequenceId"]) for node in body["nodes"]}
            else:
                self.errors += [error["errorType"] for error in body.get("errors", ())]
                self._place(serial, body["agvPosition"])

    def _place(self, serial: str, position: dict[str, Any]) -> None:
        cell = int(position["x"]), int(position["y"])
        self.together += [
            (serial, other, cell) for other, its in self.cell_of.items() if its == cell and other != serial
        ]
        self.cell_of[serial] = cell


@pytest.fixture
def agvs() -> Iterator[list[Process]]:
    """Yield a list of programs that are ended with the test."""
    made: list[Process] = []
    yield made
    for process in made:
        process.end()


@pytest.mark.parametrize(
    ("site", "n", "tasks"), [("small", 3, 6), pytest.param("dense", 20, 40, marks=pytest.mark.slow)]
)
def test_our_master_has_virtual_agvs_bring_parcels(
    site: str, n: int, tasks: int, tmp_path: Path, agvs: list[Process]
) -> None:
    """Row V2: all orders are done, no two vehicles say that they are in one cell, at most one update for each node."""
    setup = RunSetup.of(RunConfig(site=site, robots=n, fidelity=Fidelity.GRID))
    poses = setup.graph.state_pose[setup.start_states].round(4).tolist()
    with broker("amqtt") as url:
        ear = Ear(url)
        program = ["node", str(SCRIPTS / "vda_5050_lib_agvs.js"), url, site, "5", json.dumps(poses)]
        agvs.append(Process(program, MODULES))
        agvs[0].line("ready")
        words = [word for k in range(n) for word in ("--vehicle", f"acme/agv_{k}")]
        words += ["--site", site, "--tasks", str(tasks), "--speed", "5", "--duration", "7200"]
        with ear:
            result = driven(url, tmp_path / "run", *DIALECT, *words, most_s=1500.0)
    assert (result["tasks_done"], result["tasks_failed"]) == (tasks, 0)
    assert (ear.errors, ear.together) == ([], [])
    assert len(ear.cell_of) == n
    for serial, orders in ear.orders.items():
        n_begun = len({order for order, _ in orders})
        assert len(orders) <= len(ear.nodes[serial]) - n_begun, serial
