"""Plans that look ahead: what they are told, what they are offered, and who waits for a car that is busy."""

import json
import sys
from collections.abc import Callable
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from fleet.config import AllocationConfig, ArmConfig, Fidelity, RunConfig
from fleet.dispatch.horizon import PRESSES_S
from fleet.run.events import Event
from fleet.simulation import Simulation
from fleet.tasks.board import DONE_STATES, TaskState
from fleet.tasks.reasons import PairReason, TaskReason
from planners.allocation.problem import AllocationProblem, Assignment
from planners.allocation.regret_lns import RegretLns

Make = Callable[..., Simulation]
DUE_S = 1000.0
ASKED: list[AllocationProblem] = []


class Listener(RegretLns):
    """Keeps what it is asked."""

    def allocate(self, problem: AllocationProblem) -> Assignment:
        ASKED.append(problem)
        return super().allocate(problem)


@pytest.fixture
def make(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Make:
    """Make a run of parcels from `pick_1` to `drop_1`, one for each due date."""
    module = ModuleType("own_allocators")
    module.Listener = Listener  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "own_allocators", module)
    ASKED.clear()

    def made(allocator: str, due_s: list[float], log: list[Event] | None = None) -> Simulation:
        path = tmp_path / "orders.json"
        parcel = {"release_s": 0, "pick": "pick_1", "drop": "drop_1", "mass_kg": 0.3, "size_m": 0.06}
        path.write_text(json.dumps([parcel | {"id": f"o{k}", "due_s": due} for k, due in enumerate(due_s)]))
        config = RunConfig(
            fidelity=Fidelity.GRID,
            arms=ArmConfig(workers_n=0),
            robots=1,
            orders=path,
            allocation=AllocationConfig(allocator=allocator),
        )
        return Simulation(config, on_event=None if log is None else log.append)

    return made


@pytest.mark.parametrize("allocator", ["greedy", "regret_lns"])
def test_what_is_due_first_is_on_offer_however_many_came_before(make: Make, allocator: str) -> None:
    """The last order of the file is the only one that is urgent."""
    with make(allocator, [3000.0] * 19 + [150.0]) as simulation:
        while simulation.board.count(TaskState.DELIVERED) + simulation.board.count(TaskState.COLLECTED) < 2:
            simulation.tick()
        assert simulation.board.named("o19").state in DONE_STATES


def test_a_plan_knows_ages_due_dates_and_the_plan_before(make: Make) -> None:
    with make("own_allocators.Listener", [DUE_S] * 10) as simulation:
        while simulation.sim_s <= 10.0:
            now_s, n_asked = simulation.sim_s, len(ASKED)
            simulation.tick()
        assert len(ASKED) == n_asked + 1, "every 5 s one plan"
        shop, first = ASKED[-1].shop, ASKED[0].shop
        n_ready = simulation.board.count(TaskState.READY)
    assert first is not None
    assert shop is not None
    assert 3 <= shop.n_jobs <= n_ready
    np.testing.assert_allclose(shop.due_s, DUE_S - now_s)
    assert shop.weight is not None
    # All are due in a long time, and press by that alone, the longest least.
    assert ((shop.weight > 1.0) & (shop.weight < 1.0 + AllocationConfig().due * 100.0 / PRESSES_S)).all()
    np.testing.assert_allclose(shop.late_cost, AllocationConfig().late_s)
    assert shop.ready_s[0] > 0.0, "the car is busy"
    assert shop.first_order is not None
    assert sorted(shop.first_order.tolist()) == list(range(shop.n_jobs)), "the search begins with the last plan"
    assert first.first_order is not None
    assert first.first_order.tolist() == [], "before the first there was none"


def test_a_task_waits_for_a_car_that_is_busy_and_knows_when_it_is_free(make: Make) -> None:
    with make("own_allocators.Listener", [DUE_S] * 2) as simulation:
        first = simulation.board.named("o0")
        second = simulation.board.named("o1")
        while TaskState.CARRIED not in (first.state, second.state):
            simulation.tick()
        carried, waiting = (first, second) if first.state is TaskState.CARRIED else (second, first)
        picked_s = simulation.sim_s
        while (
            len(ASKED) == 0
            or ASKED[-1].shop is None
            or not ASKED[-1].shop.ready_s[0]
            or simulation.sim_s < picked_s + 1
        ):
            simulation.tick()
        shop = ASKED[-1].shop
        asked_s = simulation.sim_s
        report = simulation.explain_assignment(waiting.order.name)
        assert (report.state, report.reason) == (TaskState.READY, TaskReason.PLANNED)
        assert report.cause.startswith("car_0 is to take it, and will be free in ")
        assert [pair.reason for pair in report.pairs] == [PairReason.PLANNED_LATER]
        while carried.done_s is None:
            simulation.tick()
        took_s = carried.done_s - asked_s
        assert shop is not None
        assert 0.5 * took_s <= shop.ready_s[0] <= 1.2 * took_s, "it counts from where the granted way ends"
