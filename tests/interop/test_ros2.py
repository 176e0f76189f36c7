"""ROS 2: rclpy in a foreign process sees every tick and commands a car, an arm and an order."""

import json
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from fleet.config import ArmConfig, Fidelity, RunConfig
from fleet.run.setup import RunSetup
from fleet.session import SessionConfig
from fleet.simulation import Simulation
from maps.lane_graph import REVERSE
from tests.integration.bridge_client import bridged
from tests.interop.conftest import BRIDGE, Partners

pytestmark = pytest.mark.interop("ROS 2")
CONFIG = RunConfig(
    site="small", robots=8, tasks=16, fidelity=Fidelity.PHYSICS, duration_s=3600.0, arms=ArmConfig(workers_n=0)
)


class Timed(Simulation):
    """Notes when each tick ended."""

    ended_s: dict[int, float]

    def tick(self, actions=None) -> None:
        super().tick(actions)
        self.__dict__.setdefault("ended_s", {})[round(self.sim_s * 1e9)] = time.time()


def events(out: Path) -> list[dict[str, object]]:
    return [json.loads(line) for line in (out / "run.jsonl").read_text().splitlines()]


def test_every_state_of_eight_cars_and_four_arms_arrives_with_simulated_time(tmp_path: Path, ros2: Partners) -> None:
    """Row R1: at least 99 % of the messages after discovery; how late they are depends on the machine."""
    made: list[Timed] = []

    def make(config: RunConfig, **words) -> Timed:
        made.append(Timed(config, **words))
        return made[-1]

    session = SessionConfig(out=tmp_path / "run", record=False, progress=False, speed=1.0)
    with bridged(CONFIG, session, make=make) as run:
        ros2.start(BRIDGE / "ros2_node.py", f"127.0.0.1:{run.server.port}")
        listener = ros2.start("ros2_listen.py", 600, 8, 4)
        listener.line("ready")
        came = listener.result()
    sent = made[0].ended_s
    clock = [stamp for stamp, _ in came["/clock"]]
    whole = [stamp for stamp in sent if min(clock) < stamp < max(clock)]
    assert len(came) == 1 + 2 * 8 + 4
    late = []
    for topic, messages in came.items():
        stamps = {stamp for stamp, _ in messages}
        assert stamps <= sent.keys(), topic
        assert len(stamps & set(whole)) >= 0.99 * len(whole), topic
        late += [at - sent[stamp] for stamp, at in messages]
    print(
        f"R1: {len(late)} messages, late by {1e3 * np.median(late):.2f} ms (median), "
        f"{1e3 * np.percentile(late, 95):.2f} ms (95 %)"
    )


def along_lanes(setup: RunSetup, n_moves: int) -> list[str]:
    """Places on the way of so many moves of the first car, as far as it gets; it is to stand at every fourth."""
    graph, state = setup.graph, int(setup.start_states[0])
    bays = {*setup.site.parking, *setup.site.chargers, *(one.dock.cell for one in setup.site.stations)}
    before = {state: -1}
    queue = [state]
    for here in queue:
        for move in np.flatnonzero((graph.move_from == here) & (graph.move_kind != REVERSE)).tolist():
            there = int(graph.move_to[move])
            if there not in before and int(graph.state_cell[there]) not in bays:
                before[there] = here
                queue.append(there)
    way = [queue[-1]]
    while before[way[-1]] >= 0:
        way.append(before[way[-1]])
    poses = graph.state_pose[way[::-1][1 : n_moves + 1]]
    return [f"{x:.3f},{y:.3f}{'!' if k % 4 == 0 else ''}" for k, (x, y, _) in enumerate(poses.tolist(), 1)]


def test_a_script_drives_a_car_through_four_poses_while_others_deliver(tmp_path: Path, ros2: Partners) -> None:
    """Row R2."""
    config = replace(CONFIG, robots=4, tasks=6)
    session = SessionConfig(out=tmp_path / "run", record=False, progress=False, speed=1.0)
    made: list[Simulation] = []

    def make(config: RunConfig, **words) -> Simulation:
        made.append(Simulation(config, **words))
        return made[-1]

    with bridged(config, session, make=make) as run:
        run.link.say("pause")  # until the car is in the driver's hands
        ros2.start(BRIDGE / "ros2_node.py", f"127.0.0.1:{run.server.port}")
        driver = ros2.start("ros2_drive.py", "car_0", *along_lanes(RunSetup.of(config), n_moves=16))
        driver.line("ready")
        run.link.say("pause", on=False)
        result = json.loads(driver.line("result", most_s=600.0))
        run.link.say("speed", speed=0)
        run.wait(lambda frame: made[0].board.n_closed == config.tasks, most_s=600.0)
    ended = run.end()
    stops = [one["cause"] for one in events(tmp_path / "run") if one["kind"] == "remote_stopped"]
    print(f"R2: {result['misses_m']} m, stopped {len(stops)} times: {set(stops)}")
    assert len(result["misses_m"]) == 4
    assert max(result["misses_m"]) <= 0.10
    assert result["taken"]
    assert result["released"]
    assert (ended.robot_contacts, ended.static_contacts, ended.tasks_done) == (0, 0, config.tasks)


def test_target_joints_in_joint_states_out(tmp_path: Path, ros2: Partners) -> None:
    config = replace(CONFIG, site="cell", robots=1, tasks=1, duration_s=600.0)
    session = SessionConfig(out=tmp_path / "run", record=False, progress=False, speed=1.0)
    with bridged(config, session) as run:
        ros2.start(BRIDGE / "ros2_node.py", f"127.0.0.1:{run.server.port}")
        result = json.loads(ros2.start("ros2_arm.py", "arm_0").line("result", most_s=300.0))
        run.link.say("speed", speed=0)
        run.wait(lambda frame: frame.op == "event" and is_delivered(frame.header, "remote_1"), 300.0)
    assert result.pop("stayed") < 0.01
    assert result.pop("stood_s") < 0.1
    (refused,) = result.pop("refused")
    assert "joint_2 is 9.0000 rad; valid: -2.09" in refused
    assert result == {
        "aimed": True,
        "followed": True,
        "ordered": ["remote_1"],
        "paused": True,
        "went_on": True,
        "released": True,
    }


def is_delivered(event: dict[str, Any], task: str) -> bool:
    facts = event["facts"]
    return facts.get("task") == task and facts.get("state") == "delivered"
