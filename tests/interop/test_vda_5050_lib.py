"""The MasterController of vda-5050-lib, a foreign master, has our cars and arms carry parcels; `make test-interop`."""

import json
import os
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from fleet.cli.main import main

ROOT = Path(__file__).parents[2]
MODULES = Path(os.environ.get("FLEET_NODE_MODULES", ROOT / ".partners" / "node_modules"))
pytestmark = pytest.mark.interop
pytest.importorskip("paho", reason="MQTT needs the extra vda5050")


def deliver(folder: Path, site: str, cars: int, orders: int, fidelity: str, most_s: float) -> dict[str, object]:
    """Run a warehouse and the foreign master; returns what the master has counted and the result of the run."""
    if shutil.which("node") is None:
        pytest.skip("no node")
    if not (MODULES / "vda-5050-lib").is_dir():
        pytest.skip(f"no vda-5050-lib in {MODULES}; `make test-interop` installs it")
    from tests.integration.test_mqtt import free_port

    layout = folder / "site.lif.json"
    with pytest.raises(SystemExit):
        main(["site", "export", site, str(layout)])
    url = f"mqtt://127.0.0.1:{free_port()}"
    words = ["--vda5050", url, "--broker", "--dialect", "2.0.0-coaty", "--site", site, "--robots", str(cars)]
    words += ["--fidelity", fidelity, "--speed", "0", "--duration", "36000", "--out", str(folder / "run"), "--check"]
    with subprocess.Popen(
        [sys.executable, "-m", "fleet", "serve", *words], cwd=ROOT, stdout=subprocess.PIPE, text=True
    ) as fleet:
        assert fleet.stdout is not None
        assert "cars speak VDA 5050" in fleet.stdout.readline()
        master = subprocess.run(
            ["node", str(Path(__file__).with_name("vda_5050_lib_master.js")), url, str(layout), str(cars), str(orders)],
            env=os.environ | {"NODE_PATH": str(MODULES), "MAP_ID": site},
            capture_output=True,
            text=True,
            timeout=most_s,
            check=True,
        )
        fleet.send_signal(signal.SIGINT)
        fleet.communicate(timeout=60)
    result = json.loads((folder / "run" / "result.json").read_text(encoding="utf-8"))
    return json.loads(master.stdout) | {"result": result}


@pytest.mark.parametrize(
    ("site", "cars", "orders", "fidelity"),
    [("small", 3, 6, "kinematic"), pytest.param("medium", 8, 40, "physics", marks=pytest.mark.slow)],
)
def test_a_foreign_master_has_all_its_orders_done(
    site: str, cars: int, orders: int, fidelity: str, tmp_path: Path
) -> None:
    told = deliver(tmp_path, site, cars, orders, fidelity, most_s=3000.0)
    result = told["result"]
    assert isinstance(result, dict)
    assert (told["processed"], told["picked"], told["dropped"]) == (orders, orders, orders)
    assert (told["errors"], told["invalid"], told["cancelled"]) == ([], 0, 0)
    assert (result["robot_contacts"], result["static_contacts"]) == (0, 0)
    assert result["tasks_done"] == orders
    assert told["traversed"] == 4 * orders
