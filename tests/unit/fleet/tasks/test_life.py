"""Any sequence of legal steps: every task is in exactly one state, and its life is unbroken."""

import numpy as np
import pytest

from fleet.tasks.board import OPEN_STATES, IllegalTransition, TaskBoard, TaskState
from fleet.tasks.order import Delivery
from tests.lives import Lives


def order(name: str, release_s: float) -> Delivery:
    return Delivery(
        name=name, release_s=release_s, pick="pick_1", drop="drop_1", mass_kg=0.2, size_m=(0.05, 0.05, 0.05)
    )


@pytest.mark.parametrize("seed", range(20))
def test_nothing_is_lost_in_random_lives(seed: int) -> None:
    rng = np.random.default_rng(seed)
    board = TaskBoard([order(f"o{k}", float(k)) for k in range(12)])
    lives = Lives(board)
    for step in range(300):
        now_s = step / 10
        if rng.random() < 0.2:
            board.release_due(now_s)
        task, state = board.tasks[int(rng.integers(12))], list(TaskState)[int(rng.integers(len(TaskState)))]
        before = (task.state, len(lives.of[task.order.name]))
        try:
            board.move(task, state, now_s, f"step {step}")
        except IllegalTransition:
            assert (task.state, len(lives.of[task.order.name])) == before
        found = board.in_state(*TaskState)
        assert sorted(task.index for task in found) == list(range(12))
        assert all(task in board.in_state(task.state) for task in board.tasks)
        assert board.finished == (not any(task.state in OPEN_STATES for task in board.tasks))
    for task in board.tasks:
        steps = lives.of[task.order.name]
        states = [TaskState.ORDERED, *(step.state for step in steps)]
        assert [step.before for step in steps] == states[:-1]
        assert states[-1] is task.state
        assert not set(states[:-1]) - OPEN_STATES, "nothing comes after an end"


def test_a_cancelled_order_is_not_released() -> None:
    board = TaskBoard([order("a", 5.0)])
    board.move(board.named("a"), TaskState.CANCELLED, 1.0, "cancelled")
    assert board.release_due(6.0) == []
    assert board.finished
