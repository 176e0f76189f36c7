"""ROS 1: code as in tutorials, under real rospy, sees joints and moves them."""

import json
from pathlib import Path

import pytest

from fleet.config import ArmConfig, Fidelity, RunConfig
from fleet.session import SessionConfig
from tests.integration.bridge_client import bridged
from tests.interop.conftest import BRIDGE, Partners

pytestmark = pytest.mark.interop("ROS 1")


def test_a_tutorial_moves_an_arm_and_a_car(tmp_path: Path, ros1: Partners) -> None:
    """Row R3."""
    config = RunConfig(
        site="cell", robots=1, tasks=1, fidelity=Fidelity.PHYSICS, duration_s=3600.0, arms=ArmConfig(workers_n=0)
    )
    session = SessionConfig(out=tmp_path / "run", record=False, progress=False, speed=1.0)
    with bridged(config, session) as run:
        ros1.start(BRIDGE / "ros1_node.py", f"127.0.0.1:{run.server.port}")
        result = json.loads(ros1.start("ros1_tutorial.py", "arm_0").line("result", most_s=300.0))
    assert result == {"taken": True, "aimed": True, "driven": True, "ascending": True}
