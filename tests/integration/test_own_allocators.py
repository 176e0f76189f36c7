"""Task allocation: an allocator of one's own is checked, and what an allocator has to say is heard."""

import os
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from fleet.config import AllocationConfig, ArmConfig, Fidelity, RunConfig
from fleet.run.events import Event
from fleet.simulation import Simulation
from planners.allocation.checked import AllocationFault
from planners.allocation.greedy import Greedy
from planners.allocation.problem import AllocationProblem, Assignment, assignment
from planners.status import Status


class AllToOne:
    """Gives every vehicle the first task."""

    def allocate(self, problem: AllocationProblem) -> Assignment:
        pairs = [(vehicle, 0) for vehicle in range(len(problem.cost))]
        return assignment(problem, np.array(pairs), Status.FEASIBLE)


class Talker:
    """Greedy, with a remark."""

    def allocate(self, problem: AllocationProblem) -> Assignment:
        found = Greedy().allocate(problem)
        return Assignment(pairs=found.pairs, cost=found.cost, status=found.status, note="a remark")


def run(monkeypatch: pytest.MonkeyPatch, kind: type, log: list[Event]) -> Simulation:
    module = ModuleType("own_allocators")
    setattr(module, kind.__name__, kind)
    monkeypatch.setitem(sys.modules, "own_allocators", module)
    allocation = AllocationConfig(allocator=f"own_allocators.{kind.__name__}")
    config = RunConfig(fidelity=Fidelity.GRID, tasks=6, allocation=allocation, arms=ArmConfig(workers_n=0))
    return Simulation(config, on_event=log.append)


def test_an_answer_that_is_not_legal_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    with (
        run(monkeypatch, AllToOne, []) as simulation,
        pytest.raises(AllocationFault, match=r"allocator 'own_allocators.AllToOne': its answer has task_twice for"),
    ):
        simulation.tick()


def test_a_remark_is_logged_once(monkeypatch: pytest.MonkeyPatch) -> None:
    log: list[Event] = []
    with run(monkeypatch, Talker, log) as simulation:
        simulation.run()
        assert simulation.summary().tasks_done == 6
    (event,) = [event for event in log if event.kind == "allocator_note"]
    assert event.facts == {"allocator": "own_allocators.Talker", "note": "a remark"}


def test_the_command_finds_what_stands_where_one_is(tmp_path: Path, repository: Path) -> None:
    # As pip writes it into a folder of programs: Python looks there for modules, and not where one is.
    programs, desk = tmp_path / "bin", tmp_path / "desk"
    programs.mkdir()
    desk.mkdir()
    (programs / "fleet").write_text("from fleet.cli.main import main\n\nmain()\n", encoding="utf-8")
    (desk / "own_file.py").write_text("class Mine:\n    pass\n", encoding="utf-8")
    done = subprocess.run(
        [sys.executable, str(programs / "fleet"), "demo", "--allocator", "own_file.Yours", "--fidelity", "grid"],
        cwd=desk,
        env=os.environ | {"PYTHONPATH": str(repository)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 2
    assert "No module named" not in done.stderr
    assert "own_file" in done.stderr
