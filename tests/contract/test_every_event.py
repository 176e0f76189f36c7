"""Every kind of event: it happens, it ends, and the fleet goes on: nothing touches, nothing is lost, all is done."""

from __future__ import annotations

import math

import pytest

from fleet.config import EVENT_KINDS, ArmConfig, Fidelity, RunConfig, ScenarioEvent
from fleet.config.events import TARGETS
from fleet.run.events import Event
from fleet.simulation import Simulation
from fleet.tasks.board import DONE_STATES, TaskState

TARGET = {"car": "car_1", "arm": "arm_0", "cell": "9,6", "station": "pick_1", "fleet": "fleet", "zone": "1,1,6,6"}
PARAMETERS = {
    "human_walks": {"to_row": 1.0, "to_col": 9.0},
    "car_pushed": {"dx_m": 0.3, "dy_m": 0.2},
    "car_taken": {"dx_m": 0.3, "dy_m": 0.2},
}
BEGINS_S, ENDS_S = 12.0, 40.0
BEFORE = {"car_towed": "car_dead", "battery_changed": "battery_empty"}
"""What has to happen before some kinds."""
MAY_FAIL = {"car_pushed", "car_dead", "car_towed", "battery_empty", "battery_changed", "arm_dead", "grip_lost"}
"""Kinds after which a parcel may be where nobody can take it."""
CASES = [
    pytest.param(kind, target, id=f"{kind}-{target}")
    for kind, known in EVENT_KINDS.items()
    if not known.ends
    for target in known.targets
]


def timeline(kind: str, target: str) -> tuple[ScenarioEvent, ...]:
    """The event, what has to come before it, and what ends it."""
    name, parameters = TARGET[target], PARAMETERS.get(kind, {})
    events = [ScenarioEvent(time_s=BEGINS_S, kind=kind, target=name, parameters=parameters)]
    if kind in BEFORE:
        events.append(ScenarioEvent(time_s=BEGINS_S - 5.0, kind=BEFORE[kind], target=name))
    ending = next((one for one, known in EVENT_KINDS.items() if known.ends == kind), None)
    if ending is not None:
        events.append(ScenarioEvent(time_s=ENDS_S, kind=ending, target=name))
    return tuple(events)


def test_every_target_has_an_example() -> None:
    assert set(TARGET) == set(TARGETS)


@pytest.mark.parametrize("fidelity", [Fidelity.GRID, Fidelity.KINEMATIC])
@pytest.mark.parametrize(("kind", "target"), CASES)
def test_the_fleet_goes_on(kind: str, target: str, fidelity: Fidelity) -> None:
    log: list[Event] = []
    config = RunConfig(
        site="small",
        robots=3,
        tasks=6,
        seed=3,
        fidelity=fidelity,
        events=timeline(kind, target),
        arms=ArmConfig(workers_n=0),
    )
    with Simulation(config, on_event=log.append) as simulation:
        while not simulation.finished:
            simulation.tick()
        assert not simulation.stalled
        assert simulation.missions.faults() == []
        assert (simulation.parcel_balance(), simulation.view.inventory.misplaced()) == (0, [])
        contacts = simulation.world.contacts()
        assert (contacts.robot, contacts.static) == (0, 0)
        states = [task.state for task in simulation.board.tasks]
        if kind not in MAY_FAIL:
            assert set(states) <= set(DONE_STATES)
        assert all(task.reason for task in simulation.board.tasks if task.state is TaskState.FAILED)
    happened = [event.facts["disturbance"] for event in log if event.kind == "disturbance"]
    assert kind in happened
    if kind in ("car_dead", "battery_changed") and simulation.sim_s > ENDS_S:
        assert len([event for event in log if event.kind == "car_revived"]) == 1
    over = [event for event in log if event.kind == "disturbance_over" and event.facts["disturbance"] == kind]
    ends_in_time = EVENT_KINDS[kind].lasts and simulation.sim_s > ENDS_S
    assert len(over) == ends_in_time or EVENT_KINDS[kind].lasts_s > ENDS_S - BEGINS_S


@pytest.mark.parametrize("kind", [kind for kind, known in EVENT_KINDS.items() if known.lasts_s == math.inf])
def test_what_lasts_for_good_can_be_ended(kind: str) -> None:
    assert any(known.ends == kind for known in EVENT_KINDS.values())
