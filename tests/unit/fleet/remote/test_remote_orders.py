"""RemoteControl: orders that come while a run goes on are done like all others, or refused by name."""

from collections.abc import Iterator

import numpy as np
import pytest

from fleet.config import ArmConfig, Fidelity, RunConfig
from fleet.safety.check import SafetyCheck
from fleet.simulation import Simulation
from fleet.tasks.board import NameTaken
from fleet.tasks.fields import OrdersError

CONFIG = RunConfig(
    site="cell", robots=1, tasks=1, fidelity=Fidelity.KINEMATIC, duration_s=600.0, arms=ArmConfig(workers_n=0)
)


@pytest.fixture
def run() -> Iterator[Simulation]:
    with Simulation(CONFIG) as simulation:
        yield simulation


def test_a_delivery_that_comes_late_is_done(run: Simulation) -> None:
    check = SafetyCheck(run.view)
    for _ in range(120):
        run.tick()
    assert run.remote.order({"pick": "pick_1", "drop": "drop_1"}) == "remote_1"
    assert run.remote.order({"pick": "pick_1", "drop": "drop_1", "id": "mine", "mass_kg": 0.2}) == "mine"
    while not run.finished:
        run.tick()
        check.tick()
    summary = run.summary()
    assert (summary.tasks_done, summary.tasks_total, summary.parcel_balance) == (3, 3, 0)


def test_a_car_can_be_sent_to_a_place(run: Simulation) -> None:
    state = int(np.argmax(run.graph.state_pose[:, 0]))
    x, y, _ = run.graph.state_pose[state].tolist()
    name = run.remote.send(0, x, y)
    while not run.finished:
        run.tick()
    assert run.board.named(name).state == "done"


@pytest.mark.parametrize(
    ("fields", "words"),
    [
        ({"drop": "drop_1"}, "pick is missing"),
        ({"pick": "pick_9", "drop": "drop_1"}, "pick is 'pick_9'"),
        ({"pick": "pick_1", "drop": "drop_1", "mass_kg": 99}, "mass_kg is"),
        ({"type": "fly"}, "type is 'fly'"),
        ({"pick": "pick_1", "drop": "drop_1", "colour": "red"}, "is not a known entry"),
        ({"pick": "pick_1", "drop": "drop_1", "after": "order_1"}, "stands alone"),
        ({"pick": "pick_1", "drop": "drop_1", "every_s": 5, "times": 3}, "stands alone"),
    ],
)
def test_what_is_no_order_is_refused_by_name(run: Simulation, fields: dict[str, object], words: str) -> None:
    with pytest.raises(OrdersError, match=words):
        run.remote.order(fields)
    assert len(run.board.tasks) == 1


def test_a_name_that_is_taken_is_refused(run: Simulation) -> None:
    with pytest.raises(NameTaken, match="order 'order_1' is there already"):
        run.remote.order({"pick": "pick_1", "drop": "drop_1", "id": "order_1"})
