"""An arm planning process that dies or hangs in a run changes nothing in it; one that cannot be replaced ends it."""

from __future__ import annotations

import json
import os
import pickle
import signal
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path

import pytest

from fleet import assembly
from fleet.assembly import Parts
from fleet.cli.main import main
from fleet.config import ArmConfig, Fidelity, RunConfig
from fleet.run.setup import RunSetup
from fleet.simulation import Simulation
from fleet.stations.arms import arm_planner
from fleet.stations.arms.arm_cell import arm_cells
from fleet.stations.arms.arm_planner import ArmSetup, WorkerArmPlanner, arm_setup
from fleet.stations.arms.arm_process import ENDED, ArmProcess, ArmWorkerError
from fleet.stations.arms.transfer import ArmRequest

CONFIG = RunConfig(
    site="small",
    robots=3,
    tasks=4,
    seed=1,
    fidelity=Fidelity.KINEMATIC,
    arms=ArmConfig(workers_n=0, planner="rrt_connect_native"),
)


class Afflicted(WorkerArmPlanner):
    """Sends signals to its process just before some of its requests."""

    def __init__(self, setup: ArmSetup, faults: Mapping[int, int]) -> None:
        super().__init__(setup, silent_s=1.0)
        self._faults = faults
        self.pids = {self.process.pid}

    def submit(self, request: ArmRequest) -> int:
        self.pids.add(self.process.pid)
        if (number := self._faults.get(self._tickets + 1)) is not None:
            os.kill(self.process.pid, number)
        return super().submit(request)


class Dead(ArmProcess):
    """A process that is killed as soon as it is there."""

    def __init__(self, setup: bytes) -> None:
        super().__init__(setup)
        os.kill(self.pid, signal.SIGKILL)


def gone(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return True
    return False


@pytest.fixture(scope="module")
def undisturbed() -> tuple[int, str]:
    with Simulation(CONFIG) as simulation:
        simulation.run()
        return simulation.now, simulation.state_hash()


@pytest.mark.parametrize("fault", [signal.SIGKILL, signal.SIGSTOP])
def test_a_run_whose_planning_process_dies_or_hangs_is_the_same(
    fault: signal.Signals, undisturbed: tuple[int, str], caplog: pytest.LogCaptureFixture
) -> None:
    setup = RunSetup.of(CONFIG)
    names = tuple(station.name for station in setup.site.stations)
    told = arm_setup(arm_cells(setup.site, setup.scene), names, setup.scene.arms, CONFIG)
    planner = Afflicted(told, {2: fault, 5: fault})
    try:
        with Simulation(CONFIG, parts=Parts(arm_planner=planner)) as simulation:
            simulation.run()
            assert simulation.summary().tasks_done == 4
            assert (simulation.now, simulation.state_hash()) == undisturbed
        planner.pids.add(planner.process.pid)
    finally:
        planner.close()
    assert len(planner.pids) >= 3
    assert all(gone(pid) for pid in planner.pids)
    why = "ended with status -9" if fault is signal.SIGKILL else "was silent for"
    assert [why in line for line in caplog.messages].count(True) >= 2


def test_a_run_that_nobody_plans_for_any_more_ends_with_its_figures(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    make = assembly.make_arm_planner

    def doomed(*parts: object) -> WorkerArmPlanner:
        planner = make(*parts)  # type: ignore[arg-type]
        monkeypatch.setattr(arm_planner, "ArmProcess", Dead)
        submit = planner.submit

        def last(request: ArmRequest) -> int:
            os.kill(planner.process.pid, signal.SIGKILL)
            return submit(request)

        monkeypatch.setattr(planner, "submit", last)
        return planner

    monkeypatch.setattr(assembly, "make_arm_planner", doomed)
    words = ["--fidelity", "kinematic", "--robots", "2", "--tasks", "2", "--no-record", "--out", str(tmp_path)]
    with pytest.raises(SystemExit) as stop:
        main(["demo", *words])
    assert stop.value.code == 1
    said = capsys.readouterr().err.splitlines()[-1]
    assert said.startswith("python -m fleet: the run broke off at ")
    assert "arm planning process ended with status -9, and so did 5 before it" in said
    result = json.loads((tmp_path / "result.json").read_text(encoding="utf-8"))
    assert result["broken_off"] in said
    assert result["sim_s"] > 0
    assert (result["tasks_done"], result["tasks_total"], result["interrupted"]) == (0, 2, False)
    last_line = (tmp_path / "run.jsonl").read_text(encoding="utf-8").splitlines()[-1]
    assert json.loads(last_line)["kind"] == "run_ended"


def test_a_process_that_cannot_be_replaced_at_the_start_is_no_bad_input(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(arm_planner, "ArmProcess", Dead)
    with pytest.raises(SystemExit) as stop:
        main(["demo", "--fidelity", "kinematic", "--out", str(tmp_path / "new")])
    assert stop.value.code == 1
    assert "python -m fleet: arm planning process ended with status -9" in capsys.readouterr().err
    assert not (tmp_path / "new").exists()


def test_a_process_that_cannot_be_started_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "executable", "/no/such/python")
    with pytest.raises(ArmWorkerError, match="cannot be started: No such file"):
        ArmProcess(b"")


def test_the_end_of_a_process_is_told_with_its_status() -> None:
    process = ArmProcess(pickle.dumps(None))
    try:
        os.kill(process.pid, signal.SIGTERM)
        assert process.hear(60.0) == (ENDED, -signal.SIGTERM)
    finally:
        process.end(0.0)


def test_a_process_that_works_ends_soon_when_nobody_listens_any_more(repository: Path) -> None:
    works_for_ever = """
from fleet.stations.arms import arm_planner
from fleet.stations.arms.worker import arm_worker
def work(setup):
    while True:
        pass
arm_planner.LocalArmPlanner = work
arm_worker.main()
"""
    process = subprocess.Popen(
        [sys.executable, "-c", works_for_ever], cwd=repository, stdin=subprocess.PIPE, stdout=subprocess.PIPE
    )
    try:
        assert process.stdin is not None
        assert process.stdout is not None
        pickle.dump(None, process.stdin)
        process.stdin.flush()
        assert pickle.load(process.stdout)  # it beats
        process.stdout.close()
        assert process.wait(60.0) == 1
    finally:
        process.kill()
        process.stdin.close()
