"""The life cycle of tasks: legal steps only, each told with its cause."""

import pytest

from fleet.tasks.board import IllegalTransition, Task, TaskBoard, TaskState
from fleet.tasks.order import Delivery

LIFE = [
    TaskState.BACKLOG,
    TaskState.READY,
    TaskState.ASSIGNED,
    TaskState.LOADING,
    TaskState.CARRIED,
    TaskState.UNLOADING,
    TaskState.DELIVERED,
    TaskState.COLLECTED,
]
Steps = list[tuple[str, TaskState, TaskState, float, str]]


def order(name: str, release_s: float = 0.0) -> Delivery:
    return Delivery(
        name=name, release_s=release_s, pick="pick_1", drop="drop_1", mass_kg=0.2, size_m=(0.05, 0.05, 0.05)
    )


@pytest.fixture
def told() -> Steps:
    return []


@pytest.fixture
def board(told: Steps) -> TaskBoard:
    """Two orders for now and one for later."""

    def note(task: Task, before: TaskState, now_s: float) -> None:
        told.append((task.order.name, before, task.state, now_s, task.reason))

    board = TaskBoard([order("a"), order("b"), order("c", 10.0)])
    board.subscribe(note)
    return board


def test_orders_are_released_when_their_time_has_come(board: TaskBoard, told: Steps) -> None:
    board.release_due(0.0)
    assert [task.order.name for task in board.in_state(TaskState.BACKLOG)] == ["a", "b"]
    board.release_due(9.99)
    assert board.count(TaskState.ORDERED) == 1
    board.release_due(10.0)
    assert board.count(TaskState.ORDERED) == 0
    assert told[-1] == ("c", TaskState.ORDERED, TaskState.BACKLOG, 10.0, "release time reached")


def test_a_whole_life(board: TaskBoard, told: Steps) -> None:
    board.release_due(0.0)
    task = board.tasks[0]
    for k, state in enumerate(LIFE[1:]):
        board.move(task, state, float(k), f"step {k}")
    assert task.state is TaskState.COLLECTED
    assert task.since_s[TaskState.LOADING] == 2.0
    assert [entry[2] for entry in told if entry[0] == "a"] == LIFE
    assert told[-1][4] == "step 6"


def test_a_run_is_finished_when_every_task_has_ended(board: TaskBoard) -> None:
    board.release_due(20.0)
    for task in board.tasks:
        assert not board.finished
        board.move(task, TaskState.READY, 20.0, "")
        board.move(task, TaskState.FAILED, 20.0, "")
    assert board.finished
    assert board.count(TaskState.FAILED) == 3


NEXT = (TaskState.READY, TaskState.FAILED, TaskState.CANCELLED)


@pytest.mark.parametrize("state", [state for state in TaskState if state not in (*NEXT, TaskState.BACKLOG)])
def test_a_step_that_life_does_not_have(board: TaskBoard, told: Steps, state: TaskState) -> None:
    board.release_due(0.0)
    before = len(told)
    with pytest.raises(
        IllegalTransition, match=f"task a: backlog -> {state}; valid next states: cancelled, failed, ready"
    ):
        board.move(board.tasks[0], state, 0.0, "")
    assert board.tasks[0].state is TaskState.BACKLOG
    assert len(told) == before


def test_tasks_of_a_state_come_in_the_order_they_entered_it(board: TaskBoard) -> None:
    board.release_due(10.0)
    for index in (2, 0, 1):
        board.move(board.tasks[index], TaskState.READY, 11.0, "")
    assert [task.index for task in board.in_state(TaskState.READY)] == [2, 0, 1]
    board.move(board.tasks[0], TaskState.ASSIGNED, 12.0, "")
    assert [task.index for task in board.in_state(TaskState.READY, TaskState.ASSIGNED)] == [2, 1, 0]
