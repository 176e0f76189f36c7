"""The rosbridge server: roslibpy and roslib.js see every tick and command an arm and an order; strange pages do not."""

import json
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from fleet.config import ArmConfig, Fidelity, RunConfig
from fleet.session import SessionConfig
from tests.integration.bridge_client import BridgedRun, bridged
from tests.interop.conftest import BRIDGE, Partners, Process

SECONDS = 5.0


@pytest.fixture
def run(tmp_path: Path) -> Iterator[BridgedRun]:
    config = RunConfig(
        site="cell", robots=1, tasks=1, fidelity=Fidelity.PHYSICS, duration_s=3600.0, arms=ArmConfig(workers_n=0)
    )
    with bridged(config, SessionConfig(out=tmp_path / "run", record=False, progress=False, speed=1.0)) as run:
        yield run


@pytest.fixture
def port(run: BridgedRun) -> Iterator[int]:
    """Yield where the rosbridge server listens."""
    pytest.importorskip("websockets", reason="the rosbridge server needs the extra ros")
    words = [sys.executable, str(BRIDGE / "rosbridge.py"), f"127.0.0.1:{run.server.port}", "--port", "0"]
    server = Process(words, {})
    yield int(server.line("rosbridge: ws://127.0.0.1:"))
    server.end()


def check(result: dict) -> None:
    """Row R5: every tick is seen, and both command."""
    stamps = np.array(result.pop("stamps_s"))
    assert np.diff(stamps) == pytest.approx(1 / 60, abs=1e-6)
    assert stamps[-1] - stamps[0] >= SECONDS
    assert "pick is 'pick_9'" in result.pop("bad")["message"]
    order = {"success": True, "message": "remote_1"}
    assert result == {"taken": True, "aimed": True, "order": order, "released": True}


@pytest.mark.interop("roslibpy")
def test_roslibpy_sees_and_commands(port: int) -> None:
    pytest.importorskip("roslibpy", reason="the client needs the extra interop")
    client = Partners([sys.executable], {})
    try:
        check(json.loads(client.start("roslibpy_client.py", port, "arm_0", SECONDS).line("result", most_s=400.0)))
    finally:
        client.close()


@pytest.mark.interop("roslib")
def test_roslib_js_sees_and_commands(port: int, node: Partners) -> None:
    check(json.loads(node.start("roslib_client.mjs", port, "arm_0", SECONDS).line("result", most_s=400.0)))


@pytest.mark.interop("websockets")
def test_a_page_from_elsewhere_may_not_connect(port: int) -> None:
    from websockets.exceptions import InvalidStatus
    from websockets.sync.client import connect

    for origin in ("http://localhost:8000", "http://127.0.0.1", None):
        with connect(f"ws://127.0.0.1:{port}", origin=origin) as client:
            client.send(json.dumps({"op": "call_service", "service": "/rosapi/topics", "id": "1"}))
            assert "/arm_0/joint_states" in json.loads(client.recv(10.0))["values"]["topics"]
    for origin in ("http://example.org", "http://localhost.example.org"):
        with pytest.raises(InvalidStatus), connect(f"ws://127.0.0.1:{port}", origin=origin):
            pass


@pytest.mark.interop("websockets")
@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("nonsense", "no JSON"),
        ("[]", "is no object"),
        ('{"op": "fly"}', "op is 'fly'"),
        ('{"op": "subscribe", "topic": "/nothing"}', "topic is '/nothing'"),
        ('{"op": "publish", "topic": "/car_0/cmd_vel", "msg": {}}', "message on /car_0/cmd_vel: KeyError"),
        ('{"op": "publish", "topic": "/car_9/cmd_vel", "msg": {}}', "nobody listens to topic '/car_9/cmd_vel'"),
    ],
)
def test_nonsense_is_answered_and_survived(port: int, text: str, words: str) -> None:
    from websockets.sync.client import connect

    with connect(f"ws://127.0.0.1:{port}") as client:
        client.send(text)
        assert words in json.loads(client.recv(10.0))["msg"]
        client.send(json.dumps({"op": "call_service", "service": "/rosapi/topics"}))
        assert json.loads(client.recv(10.0))["result"]
