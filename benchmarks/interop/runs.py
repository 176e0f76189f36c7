"""Runs: a run as ROS 2 messages, against the run itself, as rosbags reads them, and what a message costs."""

from __future__ import annotations

import math
import tempfile
import time
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.harness import Kind, Row, Trial
from benchmarks.interop.others import package
from fleet.config import Fidelity, RunConfig
from fleet.recording.ros2.mcap_file import McapFile
from fleet.replay.again import load_recorded
from fleet.replay.export import export_mcap
from fleet.session import SessionConfig, run_session
from fleet.simulation import Simulation

CARS = 8
_SIM_S, _QUICK_S = 60.0, 10.0
_REPEATS = 3
_EVERY_TICK_HZ = 1e6


def measure_runs(trial: Trial) -> Iterable[Row]:
    """Export a run of eight cars and four arms, read it back, and compare every pose."""
    reader = package("rosbags.highlevel", trial, "R4")
    if reader is None or package("mcap", trial, "R4") is None:
        return
    fidelity = Fidelity.KINEMATIC if trial.quick else Fidelity.PHYSICS
    config = RunConfig(
        site="small", robots=CARS, tasks=2 * CARS, fidelity=fidelity, duration_s=_QUICK_S if trial.quick else _SIM_S
    )
    with tempfile.TemporaryDirectory() as folder:
        out, file = Path(folder) / "run", Path(folder) / "run.mcap"
        run_session(config, SessionConfig(out=out, record=False, progress=False))
        made = export_mcap(load_recorded(out), file, rate_hz=_EVERY_TICK_HZ)
        odometry, joints, n_read = _read(reader, file)
        with Simulation(config) as simulation:
            states = [_state(simulation)]
            while not simulation.finished:
                simulation.tick()
                states.append(_state(simulation))
            spent_us = min(_us_per_message(Path(folder) / "again.mcap", simulation, states) for _ in range(_REPEATS))
    trial.check(n_read == made.n_messages, f"R4: {n_read} of {made.n_messages} messages were read")
    poses = np.array([state[1] for state in states])
    arm_q = np.array([state[4] for state in states])
    off = odometry - poses
    off[..., 2] = np.vectorize(math.remainder)(off[..., 2], math.tau)
    yield Row(name=f"R4 messages that rosbags read, {fidelity}", value=n_read, unit="")
    yield Row(name="R4 pose, farthest from the run's", value=float(np.abs(off).max()), unit="m, rad", target="<= 1e-9")
    yield Row(
        name="R4 joint, farthest from the run's",
        value=float(np.abs(joints - arm_q).max()),
        unit="rad",
        target="<= 1e-9",
    )
    yield Row(name="R4 a message", value=spent_us, unit="us CPU", kind=Kind.TIME, target="<= 60")


def _state(simulation: Simulation) -> tuple[Any, ...]:
    world = simulation.world
    found = (world.car_poses(), world.car_speeds(), world.car_steering(), world.arm_positions(), world.arm_velocities())
    return simulation.sim_s, *(np.array(values) for values in found)


def _us_per_message(path: Path, simulation: Simulation, states: list[tuple[Any, ...]]) -> float:
    begin_s = time.process_time()
    with McapFile(path, simulation.view.scene) as file:
        for state in states:
            file.write(*state)
    return (time.process_time() - begin_s) / file.n_messages * 1e6


def _read(reader: Any, file: Path) -> tuple[Any, Any, int]:
    """Poses (f, n_cars, 3) and joints (f, n_arms, n_joints) of a file, and how many messages it has."""
    from rosbags.typesys import Stores, get_typestore

    poses: dict[str, list[tuple[float, float, float]]] = {}
    joints: dict[str, list[Any]] = {}
    n_read = 0
    with reader.AnyReader([file], default_typestore=get_typestore(Stores.ROS2_JAZZY)) as opened:
        for connection, _, raw in opened.messages():
            message = opened.deserialize(raw, connection.msgtype)
            n_read += 1
            if connection.topic.endswith("/odom"):
                at, turn = message.pose.pose.position, message.pose.pose.orientation
                poses.setdefault(connection.topic, []).append((at.x, at.y, 2.0 * math.atan2(turn.z, turn.w)))
            elif connection.topic.startswith("/arm_"):
                joints.setdefault(connection.topic, []).append(message.position)
    rows = [np.array([found[topic] for topic in sorted(found)]).swapaxes(0, 1) for found in (poses, joints)]
    return rows[0], rows[1], n_read
