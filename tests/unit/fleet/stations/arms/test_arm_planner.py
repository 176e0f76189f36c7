"""Planning processes that die or hang are replaced, and nothing is lost or asked too often."""

from __future__ import annotations

import pickle
from typing import Any

import numpy as np
import pytest

from fleet.stations.arms import arm_planner
from fleet.stations.arms.arm_motions import UnreachableError
from fleet.stations.arms.arm_planner import ArmSetup, WorkerArmPlanner
from fleet.stations.arms.arm_process import BEAT, ENDED, FAILED, KEEP_TREES, READY, ArmWorkerError
from fleet.stations.arms.transfer import HomeRequest

DIES = (ENDED, -9)
SILENT = None
WORKS = (BEAT, None)
SETUP = ArmSetup(
    cells=(),
    names=(),
    specs=(),
    planner="rrt_connect_native",
    n_iterations=1,
    confirm=False,
)


class Acted:
    """A process whose words are written beforehand; after the last one it is silent."""

    def __init__(self, words: list[Any]) -> None:
        self.words = list(words)
        self.told: list[int] = []
        self.n_looks = 0
        self.ended = False

    def send(self, message: bytes) -> None:
        self.told.append(pickle.loads(message)[0])

    def hear(self, timeout_s: float) -> tuple[int, Any] | None:
        assert not self.ended
        self.n_looks += 1
        return self.words.pop(0) if self.words else SILENT

    def end(self, patience_s: float) -> None:
        self.ended = True


class Stage:
    """Hands out acted processes one after the other."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, *plays: list[Any]) -> None:
        self.waiting = [Acted(words) for words in plays]
        self.on: list[Acted] = []
        monkeypatch.setattr(arm_planner, "ArmProcess", self._enter)

    def _enter(self, setup: bytes) -> Acted:
        assert pickle.loads(setup).planner == SETUP.planner
        assert all(one.ended for one in self.on), "two processes at once"
        self.on.append(self.waiting.pop(0))
        return self.on[-1]

    def told(self) -> list[list[int]]:
        return [one.told for one in self.on]


def request() -> HomeRequest:
    return HomeRequest(arm=0, q=np.zeros(7))


def test_only_what_is_open_is_asked_again_in_its_order(monkeypatch: pytest.MonkeyPatch) -> None:
    stage = Stage(monkeypatch, [(READY, None), (2, "b"), DIES], [(READY, None), (1, "a"), DIES], [(3, "c")])
    planner = WorkerArmPlanner(SETUP)
    planner.wait_ready()
    assert [planner.submit(request()) for _ in range(3)] == [1, 2, 3]
    assert [planner.result(ticket) for ticket in (1, 2, 3)] == ["a", "b", "c"]
    assert stage.told() == [[1, 2, 3], [1, 3], [3]]
    assert not stage.on[-1].ended
    planner.close()
    assert stage.on[-1].ended


def test_a_process_that_dies_before_it_is_ready(monkeypatch: pytest.MonkeyPatch) -> None:
    stage = Stage(monkeypatch, [DIES], [(READY, None)])
    WorkerArmPlanner(SETUP).wait_ready()
    assert len(stage.on) == 2


def test_trees_are_asked_for_again(monkeypatch: pytest.MonkeyPatch) -> None:
    stage = Stage(monkeypatch, [(READY, None), DIES], [(1, "a")])
    planner = WorkerArmPlanner(SETUP)
    planner.wait_ready()
    planner.keep_trees()
    planner.result(planner.submit(request()))
    assert stage.told() == [[KEEP_TREES, 1], [KEEP_TREES, 1]]


def test_each_silent_process_is_given_twice_the_time_of_the_last(monkeypatch: pytest.MonkeyPatch) -> None:
    stage = Stage(monkeypatch, [], [], [(1, "a")], [(2, "b")])
    planner = WorkerArmPlanner(SETUP, silent_s=5.0)
    assert planner.result(planner.submit(request())) == "a"
    assert [one.n_looks for one in stage.on] == [10, 20, 1]
    # After an answer all begins anew.
    assert planner.result(planner.submit(request())) == "b"
    assert [one.n_looks for one in stage.on] == [10, 20, 11, 1]


def test_a_process_that_works_is_left_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    stage = Stage(monkeypatch, [*[SILENT] * 9, WORKS] * 50 + [(1, "a")])
    planner = WorkerArmPlanner(SETUP)
    assert planner.result(planner.submit(request())) == "a"
    assert len(stage.on) == 1


@pytest.mark.parametrize("fault", [[DIES], [], [(READY, None), DIES]])
def test_faults_in_a_row_end_with_a_named_error(fault: list[Any], monkeypatch: pytest.MonkeyPatch) -> None:
    plays = [[(1, "a"), DIES], fault, fault, fault, [(2, "b"), DIES], *[fault] * 3]
    stage = Stage(monkeypatch, *plays)
    planner = WorkerArmPlanner(SETUP, silent_s=0.5, n_restarts=4)
    tickets = [planner.submit(request()) for _ in range(3)]
    assert [planner.result(ticket) for ticket in tickets[:2]] == ["a", "b"]
    stage.waiting.append(Acted(fault))
    with pytest.raises(ArmWorkerError, match=r"and so did 4 before it without an answer to 1 requests; valid: one"):
        planner.result(tickets[2])
    assert len(stage.on) == 9
    assert all(one.ended for one in stage.on)
    planner.close()


def test_what_the_planner_itself_refuses_is_not_asked_again(monkeypatch: pytest.MonkeyPatch) -> None:
    stage = Stage(monkeypatch, [(FAILED, "station pick_1: out of reach")])
    with pytest.raises(UnreachableError, match=r"^station pick_1: out of reach$"):
        WorkerArmPlanner(SETUP).wait_ready()
    stage = Stage(monkeypatch, [(READY, None), (FAILED, "ValueError: no")])
    planner = WorkerArmPlanner(SETUP)
    planner.wait_ready()
    with pytest.raises(ArmWorkerError, match="arm planning failed: ValueError: no"):
        planner.result(planner.submit(request()))
    assert len(stage.on) == 1
