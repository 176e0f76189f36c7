"""Faults of arms and stations."""

from __future__ import annotations

from collections.abc import Sequence

from fleet.config import ScenarioEvent
from fleet.incidents.faults.incident import ForEach, Incident, Once
from fleet.incidents.recovery import Recovery
from fleet.run.view import RunView
from fleet.tasks.board import TaskState

_CLOSED = "is closed"


def arm_incidents(run: RunView, recovery: Recovery) -> dict[str, Incident]:
    """What can happen to arms and stations, by kind of event."""
    arms, covered, interventions = run.arm_manager, run.perception.covered, run.dispatcher.rules.interventions
    return {
        "arm_slow": ForEach(lambda arm, event: arms.slow(arm, event.value("factor")), lambda arm: arms.slow(arm, 1.0)),
        "arm_dead": ArmDead(run, recovery),
        "grip_lost": GripLost(run),
        "camera_blind": ForEach(lambda arm, event: covered.add(arm), covered.discard),
        "station_closed": ForEach(
            lambda arm, event: interventions.close_station(arm, run.sim_s, _CLOSED, for_good=event.is_for_good),
            lambda arm: interventions.open_station(arm, _CLOSED),
        ),
    }


class ArmDead:
    """An arm stands still where it is: its station is closed, its task fails, and the car below it cannot leave."""

    def __init__(self, run: RunView, recovery: Recovery) -> None:
        self._run, self._recovery = run, recovery
        self._under: dict[int, int] = {}

    def begin(self, event: ScenarioEvent, targets: Sequence[int]) -> bool:
        """See `Incident`."""
        run, for_good = self._run, event.is_for_good
        for arm in targets:
            run.arm_manager.stop([arm])
            run.arm_manager.dead[arm] = True
            run.dispatcher.rules.interventions.close_station(arm, run.sim_s, _as_dead(arm), for_good=for_good)
            car = int(run.missions.served[arm])
            clear = run.arm_manager.services[arm].dock_is_clear
            if not for_good or car < 0 or clear:
                continue
            task = run.missions.task_of[car]
            if task is not None and task.state in (TaskState.LOADING, TaskState.UNLOADING):
                run.board.move(task, TaskState.FAILED, run.sim_s, f"arm_{arm} is dead")
            self._under[arm] = car
            self._recovery.lose_car(car, f"arm_{arm} stands dead over car_{car}", by=f"arm_{arm}")
        return True

    def end(self, targets: Sequence[int]) -> None:
        """See `Incident`."""
        for arm in targets:
            self._run.arm_manager.go_on([arm])
            self._run.arm_manager.dead[arm] = False
            self._run.dispatcher.rules.interventions.open_station(arm, _as_dead(arm))
            if arm in self._under:
                self._recovery.revive(self._under.pop(arm), by=f"arm_{arm}")


def _as_dead(arm: int) -> str:
    return f"is closed, as arm_{arm} is dead"


class GripLost(Once):
    """An arm's tool fails while it carries a parcel."""

    def __init__(self, run: RunView) -> None:
        self._run = run
        self._since_s: dict[int, float] = {}

    def begin(self, event: ScenarioEvent, targets: Sequence[int]) -> bool:
        """See `Incident`; it waits until the arm has carried a parcel for as long as is said."""
        (arm,) = targets
        if not self._run.arm_manager.services[arm].carries:
            self._since_s.pop(arm, None)
            return False
        since_s = self._since_s.setdefault(arm, self._run.sim_s)
        if self._run.sim_s - since_s < event.value("carried_s"):
            return False
        del self._since_s[arm]
        self._run.world.fail_grip(arm)
        return True
