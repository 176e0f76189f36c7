"""Faults of arms and stations."""

from __future__ import annotations

from collections.abc import Sequence

from fleet.config import ScenarioEvent
from fleet.incidents.faults.incident import Once
from fleet.incidents.recovery import Recovery
from fleet.run.view import RunView
from fleet.tasks.board import TaskState


class ArmSlow:
    """An arm plays its motions at a fraction of their speed."""

    def __init__(self, run: RunView) -> None:
        self._run = run

    def begin(self, event: ScenarioEvent, targets: Sequence[int]) -> bool:
        """See `Incident`."""
        for arm in targets:
            self._run.arm_manager.slow(arm, event.value("factor"))
        return True

    def end(self, targets: Sequence[int]) -> None:
        """See `Incident`."""
        for arm in targets:
            self._run.arm_manager.slow(arm, 1.0)


class StationClosed:
    """A station takes no more cars; those that have booked it are served."""

    def __init__(self, run: RunView, for_good_s: float) -> None:
        self._run, self._for_good_s = run, for_good_s

    def begin(self, event: ScenarioEvent, targets: Sequence[int]) -> bool:
        """See `Incident`."""
        for arm in targets:
            self._run.dispatcher.rules.interventions.close_station(
                arm, self._run.sim_s, "is closed", for_good=event.duration_s > self._for_good_s
            )
        return True

    def end(self, targets: Sequence[int]) -> None:
        """See `Incident`."""
        for arm in targets:
            self._run.dispatcher.rules.interventions.open_station(arm)


class ArmDead:
    """An arm stands still where it is: its station is closed, its task fails, and the car below it cannot leave."""

    def __init__(self, run: RunView, recovery: Recovery, for_good_s: float) -> None:
        self._run, self._recovery, self._for_good_s = run, recovery, for_good_s
        self._under: dict[int, int] = {}

    def begin(self, event: ScenarioEvent, targets: Sequence[int]) -> bool:
        """See `Incident`."""
        run, for_good = self._run, event.duration_s > self._for_good_s
        for arm in targets:
            run.arm_manager.stop([arm])
            run.dispatcher.rules.interventions.close_station(arm, run.sim_s, f"arm_{arm} is dead", for_good=for_good)
            car = int(run.missions.served[arm])
            clear = run.arm_manager.services[arm].dock_is_clear
            if not for_good or car < 0 or clear:
                continue
            task = run.missions.task_of[car]
            if task is not None and task.state in (TaskState.LOADING, TaskState.UNLOADING):
                run.board.move(task, TaskState.FAILED, run.sim_s, f"arm_{arm} is dead")
            self._under[arm] = car
            self._recovery.lose_car(car, f"arm_{arm} stands dead over car_{car}")
        return True

    def end(self, targets: Sequence[int]) -> None:
        """See `Incident`."""
        for arm in targets:
            self._run.arm_manager.go_on([arm])
            self._run.dispatcher.rules.interventions.open_station(arm)
            if arm in self._under:
                self._recovery.revive(self._under.pop(arm))


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
        self._run.world.fail_grip(arm)
        return True


class CameraBlind:
    """The camera of a station sees nothing."""

    def __init__(self, run: RunView) -> None:
        self._run = run

    def begin(self, event: ScenarioEvent, targets: Sequence[int]) -> bool:
        """See `Incident`."""
        del event
        self._run.perception.covered.update(targets)
        return True

    def end(self, targets: Sequence[int]) -> None:
        """See `Incident`."""
        self._run.perception.covered.difference_update(targets)
