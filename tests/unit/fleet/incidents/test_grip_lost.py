"""GripLost: a tool fails once its arm has carried a parcel for as long as is said, each time anew."""

from types import SimpleNamespace
from typing import Any

from fleet.config import ScenarioEvent
from fleet.incidents.faults.arms import GripLost


def test_the_time_of_the_grip_before_does_not_count() -> None:
    failed: list[float] = []
    run: Any = SimpleNamespace(sim_s=0.0, arm_manager=SimpleNamespace(services=[SimpleNamespace(carries=True)]))
    run.world = SimpleNamespace(fail_grip=lambda arm: failed.append(run.sim_s))
    lost = GripLost(run)
    event = ScenarioEvent(time_s=0.0, kind="grip_lost", target="arm_0", parameters={"carried_s": 1.0})
    for begun_s in (0.0, 50.0):
        run.sim_s = begun_s
        while not lost.begin(event, [0]):
            run.sim_s += 0.5
    assert failed == [1.0, 51.0]
