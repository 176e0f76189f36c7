"""Faults of cars, and what operators do to cars."""

from __future__ import annotations

from collections.abc import Sequence

from fleet.config import ScenarioEvent
from fleet.incidents.faults.incident import ForEach, Incident, Once
from fleet.incidents.recovery import EMPTY, Recovery
from fleet.missions.phases import CarPhase
from fleet.run.view import RunView


def car_incidents(run: RunView, recovery: Recovery) -> dict[str, Incident]:
    """What can happen to cars, and what operators do to them, by kind of event."""
    driver, world, hindrances = run.driver, run.world, run.driver.hindrances
    interventions = run.dispatcher.rules.interventions
    # A car that has lost its place or its commands stands by itself.
    held = ForEach(lambda car, event: hindrances.hold(car), hindrances.let_go)

    def empty(car: int, event: ScenarioEvent) -> None:
        del event
        if run.batteries is not None:
            run.batteries.charge[car] = 0.0
        recovery.lose_car(car, f"the battery of car_{car} is empty", by=EMPTY)

    def changed(car: int, event: ScenarioEvent) -> None:
        del event
        if run.batteries is not None:
            run.batteries.charge[car] = 1.0
        recovery.revive(car, by=EMPTY)

    return {
        "car_dead": ForEach(
            lambda car, event: recovery.lose_car(car, f"car_{car} is dead", by=event.kind),
            lambda car: recovery.revive(car, by="car_dead"),
        ),
        "car_towed": CarTowed(recovery),
        "car_pushed": ForEach(lambda car, event: world.shove_car(car, *_moved(event))),
        "car_slow": ForEach(
            lambda car, event: hindrances.slow(car, event.value("factor")), lambda car: hindrances.slow(car, 1.0)
        ),
        "car_out": ForEach(
            lambda car, event: interventions.take_out(car, run.sim_s, for_good=event.is_for_good),
            interventions.bring_back,
        ),
        "car_taken": CarTaken(run, recovery),
        "battery_empty": ForEach(empty),
        "battery_changed": ForEach(changed),
        "pose_noisy": ForEach(
            lambda car, event: driver.blur(car, event.value("factor")), lambda car: driver.blur(car, 1.0)
        ),
        "pose_lost": held,
        "commands_late": ForEach(
            lambda car, event: hindrances.delay(car, round(event.value("delay_s") / run.tick_s), run.tick_s),
            lambda car: hindrances.delay(car, 0, run.tick_s),
        ),
        "commands_lost": held,
        "emergency_stop": EmergencyStop(run),
    }


def _moved(event: ScenarioEvent) -> tuple[float, float, float]:
    """How far a car is moved along x and y, and about z [m, m, rad]."""
    return event.value("dx_m"), event.value("dy_m"), event.value("dyaw_rad")


class CarTowed(Once):
    """A dead car is pulled to a free parking place, without what lies in its tray; it stays dead."""

    def __init__(self, recovery: Recovery) -> None:
        self._recovery = recovery

    def begin(self, event: ScenarioEvent, targets: Sequence[int]) -> bool:
        """See `Incident`."""
        del event
        return all([self._recovery.tow(car) for car in targets])


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
        self._moved[car] = _moved(event)
        return True

    def end(self, targets: Sequence[int]) -> None:
        """See `Incident`."""
        (car,) = targets
        self._run.world.shove_car(car, *self._moved.pop(car))
        self._recovery.give_back(car)


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
            run.driver.hindrances.hold(car)
        if whole:
            run.arm_manager.stop(range(run.world.n_arms))
        self._stopped.setdefault(tuple(targets), []).append((cars, whole))
        return True

    def end(self, targets: Sequence[int]) -> None:
        """See `Incident`."""
        cars, whole = self._stopped[tuple(targets)].pop()
        for car in cars:
            self._run.driver.hindrances.let_go(car)
        if whole:
            self._run.arm_manager.go_on(range(self._run.world.n_arms))
