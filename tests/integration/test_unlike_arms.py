"""Stations with unlike arms: each is planned for, moved, drawn and told as what it is."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from fleet.cli.main import main
from fleet.config import ArmConfig, Fidelity, Grip, RunConfig
from fleet.errors import ConfigError
from fleet.recording.rerun_stream.poses import ArmChain
from fleet.robots import ARMS
from fleet.simulation import Simulation
from fleet.stations.service_time import Direction
from fleet.tasks.board import TaskState
from fleet.world.site_scene import scene_of
from maps.site import load_site, save_site
from maps.stations import StationOptions
from planners.motion.arm.kinematics import link_frames

SHORT = replace(ARMS["panda"], name="short", reach_m=(0.35, 0.5))
"""An arm that cannot reach a tray from where arms stand by default."""
LAME = replace(ARMS["xarm"], name="lame", flange="link5")
"""An arm whose file has a joint less than it should."""
HERE = "tests.integration.test_unlike_arms"


def site_file(folder: Path, **arms: str) -> str:
    """The smallest site with other arms at its stations."""
    options = {station: StationOptions(arm=arm) for station, arm in arms.items()}
    path = folder / "unlike.toml"
    save_site(replace(load_site("cell"), name="unlike", options=options), path)
    return str(path)


def run(site: str, **settings: object) -> Simulation:
    """One car and two deliveries, done."""
    config = RunConfig(site=site, robots=1, tasks=2, arms=ArmConfig(workers_n=0), **settings)  # type: ignore[arg-type]
    with Simulation(config) as simulation:
        simulation.run()
        assert all(task.state is TaskState.COLLECTED for task in simulation.board.tasks)
        assert simulation.arm_manager.n_dropped == 0
        assert simulation.world.contacts().robot + simulation.world.contacts().static == 0
    return simulation


@pytest.mark.parametrize("fidelity", [Fidelity.KINEMATIC, pytest.param(Fidelity.MIXED, marks=pytest.mark.slow)])
def test_a_panda_loads_and_an_xarm_unloads(tmp_path: Path, fidelity: Fidelity) -> None:
    simulation = run(site_file(tmp_path, pick_1="panda", drop_1="xarm"), fidelity=fidelity)
    assert [spec.name for spec in simulation.scene.arms.specs] == ["panda", "xarm"]
    assert simulation.scene.arm_base[:, 2].tolist() == [0.0, 0.15]
    assert [box.kind for box in simulation.scene.boxes].count("stand") == 1
    for arm, spec in enumerate(simulation.scene.arms.specs):  # at rest again, each where its own model rests
        q = simulation.world.arm_positions()[arm]
        np.testing.assert_allclose(q[: spec.n_joints], spec.home_rad, atol=2e-3)
        assert not q[spec.n_joints :].any()
    for slip in simulation.figures.slip_meter.slips if simulation.figures.slip_meter else ():
        assert slip.slip_m < 0.001


@pytest.mark.slow
@pytest.mark.parametrize("grip", Grip)
def test_the_engine_carries_parcels_with_both(tmp_path: Path, grip: Grip) -> None:
    simulation = run(site_file(tmp_path, pick_1="panda", drop_1="xarm"), fidelity=Fidelity.PHYSICS, grip=grip)
    meter = simulation.figures.slip_meter
    assert meter is not None
    assert [slip.arm for slip in meter.slips] == [0, 1, 0, 1]
    assert max(slip.slip_m for slip in meter.slips) < (0.005 if grip is Grip.FRICTION else 0.001)


def test_before_an_arm_has_done_anything_its_model_tells_how_long_it_takes(tmp_path: Path) -> None:
    site = site_file(tmp_path, pick_1="panda")
    config = RunConfig(site=site, robots=1, tasks=1, fidelity=Fidelity.KINEMATIC, arms=ArmConfig(workers_n=0))
    with Simulation(config) as simulation:
        times = [simulation.stations.times.of(arm, Direction.TO_CAR) for arm in (0, 1)]
        assert [time.mean_s for time in times] == [ARMS["panda"].service.mean_s, ARMS["iiwa"].service.mean_s]
        assert times[0].mean_s < times[1].mean_s


def test_links_are_drawn_where_each_model_has_them(tmp_path: Path) -> None:
    site = load_site(site_file(tmp_path, pick_1="panda", drop_1="xarm"))
    scene = scene_of(site, np.zeros((0, 3)), Grip.SUCTION)
    q = scene.arm_start + 0.1 * (np.arange(7) < scene.arms.n_joints[:, None])
    positions, _ = ArmChain(scene.arms).link_poses(np.zeros((2, 4)), q[None])
    for arm, spec in enumerate(scene.arms.specs):
        frames = link_frames(spec.base_from_joint, q[arm, : spec.n_joints])
        np.testing.assert_allclose(positions[: spec.n_joints + 1, 0, arm], frames[:, :3, 3], atol=1e-9)


def test_the_arm_of_a_site_goes_before_that_of_the_run(tmp_path: Path) -> None:
    site = load_site(site_file(tmp_path, drop_1="xarm"))
    scene = scene_of(site, np.zeros((0, 3)), Grip.FRICTION, ArmConfig(model="panda"))
    assert [(spec.name, spec.tool.name) for spec in scene.arms.specs] == [("panda", "friction"), ("xarm", "friction")]


def refused(words: list[str], capsys: pytest.CaptureFixture[str]) -> str:
    with pytest.raises(SystemExit) as stop:
        main(words)
    said = capsys.readouterr()
    assert (stop.value.code, said.out, said.err.count("\n")) == (2, "", 1)
    return said.err.strip()


def test_bad_arms_are_refused_in_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "out"
    demo = ["demo", "--fidelity", "kinematic", "--robots", "1", "--out", str(out), "--site"]
    said = refused([*demo, site_file(tmp_path, drop_1="xarn")], capsys)
    assert "site unlike: stations.drop_1.arm is 'xarn' (did you mean xarm?); valid: iiwa, panda, xarm or" in said
    said = refused([*demo, site_file(tmp_path, pick_1=f"{HERE}.SHORT")], capsys)
    assert "pick_1: arm 'short' does not reach the tray of a docked car" in said
    assert "0.60 m from its base; valid: 0.35 to 0.5 m" in said
    said = refused([*demo, site_file(tmp_path, pick_1=f"{HERE}.LAME")], capsys)
    assert "arm lame" in said
    assert "5 revolute joints up to link 'link5'" in said
    assert "valid: 6" in said
    assert not out.exists()


def test_arms_of_agents_are_all_alike(tmp_path: Path) -> None:
    from fleet.envs.warehouse.control.hands import agents_arm

    site = load_site(site_file(tmp_path, pick_1="panda"))
    with pytest.raises(ConfigError, match="arms of the models panda, iiwa; valid: arms of one model"):
        agents_arm(scene_of(site, np.zeros((0, 3)), Grip.SUCTION))
    with pytest.raises(ConfigError, match="'panda'; valid: arms of 7 joints with limits that are the same"):
        agents_arm(scene_of(load_site("cell"), np.zeros((0, 3)), Grip.SUCTION, ArmConfig(model="panda")))
