"""Faults of cars, and what operators do to cars."""

from __future__ import annotations

from collections.abc import Sequence

from fleet.config import ScenarioEvent
from fleet.incidents.faults.incident import Once
from fleet.incidents.recovery import Recovery
from fleet.missions.phases import CarPhase
from fleet.run.view import RunView


class CarDead:
    """A car stops for good; when it is repaired, what lies in its tray is taken out, and it comes back to its lane."""

    def __init__(self, recovery: Recovery) -> None:
        self._recovery = recovery

    def begin(self, event: ScenarioEvent, targets: Sequence[int]) -> bool:
        """See `Incident`."""
        del event
        for car in targets:
            self._recovery.lose_car(car, f"car_{car} is dead")
        return True

    def end(self, targets: Sequence[int]) -> None:
        """See `Incident`."""
        for car in targets:
            self._recovery.revive(car)


class CarTowed(Once):
    """A dead car is pulled to a free parking place, without what lies in its tray; it stays dead."""

    def __init__(self, recovery: Recovery) -> None:
        self._recovery = recovery

    def begin(self, event: ScenarioEvent, targets: Sequence[int]) -> bool:
        """See `Incident`."""
        del event
        return all([self._recovery.tow(car) for car in targets])


class CarPushed(Once):
    """Somebody shoves a car aside."""

    def __init__(self, run: RunView) -> None:
        self._run = run

    def begin(self, event: ScenarioEvent, targets: Sequence[int]) -> bool:
        """See `Incident`."""
        for car in targets:
            self._run.world.shove_car(car, event.value("dx_m"), event.value("dy_m"), event.value("dyaw_rad"))
        return True


class CarSlow:
    """A car drives at a fraction of its speed."""

    def __init__(self, run: RunView) -> None:
        self._run = run

    def begin(self, event: ScenarioEvent, targets: Sequence[int]) -> bool:
        """See `Incident`."""
        for car in targets:
            self._run.driver.slow(car, event.value("factor"))
        return True

    def end(self, targets: Sequence[int]) -> None:
        """See `Incident`."""
        for car in targets:
            self._run.driver.slow(car, 1.0)


class CarOut:
    """A car leaves service as planned: it does what it carries, takes no more tasks, and parks."""

    def __init__(self, run: RunView, for_good_s: float) -> None:
        self._run, self._for_good_s = run, for_good_s

    def begin(self, event: ScenarioEvent, targets: Sequence[int]) -> bool:
        """See `Incident`."""
        for_good = event.duration_s > self._for_good_s
        for car in targets:
            self._run.dispatcher.rules.interventions.take_out(car, self._run.sim_s, for_good=for_good)
        return True

    def end(self, targets: Sequence[int]) -> None:
        """See `Incident`."""
        for car in targets:
            self._run.dispatcher.rules.interventions.bring_back(car)


class CarTaken:
    """An operator drives a car by hand, a little aside, and gives it back."""

    def __init__(self, run: RunView, recovery: Recovery) -> None:
        self._run, self._recovery = run, recovery
        self._moved: dict[int, tuple[float, float, float]] = {}

    def begin(self, event: ScenarioEvent, targets: Sequence[int]) -> bool:
        """See `Incident`."""
        (car,) = targets
        if not self._recovery.take(car):
            return False
        self._moved[car] = event.value("dx_m"), event.value("dy_m"), event.value("dyaw_rad")
        return True

    def end(self, targets: Sequence[int]) -> None:
        """See `Incident`."""
        (car,) = targets
        self._run.world.shove_car(car, *self._moved.pop(car))
        self._recovery.give_back(car)


class BatteryEmpty(Once):
    """A battery is empty all at once; a car without one stops as if it had."""

    def __init__(self, run: RunView, recovery: Recovery) -> None:
        self._run, self._recovery = run, recovery

    def begin(self, event: ScenarioEvent, targets: Sequence[int]) -> bool:
        """See `Incident`."""
        del event
        for car in targets:
            if self._run.batteries is not None:
                self._run.batteries.charge[car] = 0.0
            self._recovery.lose_car(car, f"the battery of car_{car} is empty")
        return True


class PoseNoisy:
    """What a car measures of its place is worse than usual."""

    def __init__(self, run: RunView) -> None:
        self._run = run

    def begin(self, event: ScenarioEvent, targets: Sequence[int]) -> bool:
        """See `Incident`."""
        for car in targets:
            self._run.driver.blur(car, event.value("factor"))
        return True

    def end(self, targets: Sequence[int]) -> None:
        """See `Incident`."""
        for car in targets:
            self._run.driver.blur(car, 1.0)


class CarHeld:
    """Cars stand where they are until it is over: a car that has lost its place or its commands does so by itself."""

    def __init__(self, run: RunView) -> None:
        self._run = run

    def begin(self, event: ScenarioEvent, targets: Sequence[int]) -> bool:
        """See `Incident`."""
        del event
        for car in targets:
            self._run.driver.hold(car)
        return True

    def end(self, targets: Sequence[int]) -> None:
        """See `Incident`."""
        for car in targets:
            self._run.driver.let_go(car)


class CommandsLate:
    """What a car is told reaches it late."""

    def __init__(self, run: RunView) -> None:
        self._run = run

    def begin(self, event: ScenarioEvent, targets: Sequence[int]) -> bool:
        """See `Incident`."""
        for car in targets:
            self._run.driver.delay(car, round(event.value("delay_s") / self._run.tick_s))
        return True

    def end(self, targets: Sequence[int]) -> None:
        """See `Incident`."""
        for car in targets:
            self._run.driver.delay(car, 0)


class EmergencyStop:
    """Everything that moves stands still: cars where they are, and arms if the whole fleet is meant."""

    def __init__(self, run: RunView) -> None:
        self._run = run
        self._stopped: dict[tuple[int, ...], list[tuple[list[int], bool]]] = {}

    def begin(self, event: ScenarioEvent, targets: Sequence[int]) -> bool:
        """See `Incident`."""
        run, whole = self._run, event.target == "fleet"
        cars = [car for car in targets if run.missions.phase[car] is not CarPhase.DEAD]
        for car in cars:
            run.driver.hold(car)
        if whole:
            run.arm_manager.stop(range(run.world.n_arms))
        self._stopped.setdefault(tuple(targets), []).append((cars, whole))
        return True

    def end(self, targets: Sequence[int]) -> None:
        """See `Incident`."""
        cars, whole = self._stopped[tuple(targets)].pop()
        for car in cars:
            self._run.driver.let_go(car)
        if whole:
            self._run.arm_manager.go_on(range(self._run.world.n_arms))
