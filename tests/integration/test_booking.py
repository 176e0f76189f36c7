"""Stations are booked: an arm that has become slow holds cars back where they are in nobody's way."""

import numpy as np
import pytest

from fleet.config import AllocationConfig, ArmConfig, Fidelity, RunConfig, ScenarioEvent
from fleet.dispatch.dispatcher import CALL_S
from fleet.insight.metrics import Summary
from fleet.insight.time_accounts import STANDING_MPS
from fleet.missions.admission import NEAR_MOVES
from fleet.missions.phases import CarPhase
from fleet.run.events import Event
from fleet.simulation import Simulation

SLOW_SERVICE_S = 22.5
"""What a transfer of 7 s takes at a third of the speed, with a margin."""

LEARNT_S = 80.0
"""By then the arm has been found to be slow."""


class Watch:
    """The longest time any car stood on a lane cell, and the most cars a station ever had."""

    def __init__(self, n_cars: int) -> None:
        self.longest_s = 0.0
        self.longest_passing_s: dict[int, float] = {}
        """The same of cars that were not on their way to a station, once it was known to be slow, by station."""
        self.most = 0
        self._still_s = np.zeros(n_cars)
        self._unbooked_s: dict[int, dict[int, float]] = {}

    def look(self, simulation: Simulation) -> None:
        site, bookings = simulation.site, simulation.missions.bookings
        bays = {*site.parking, *site.chargers, *(station.dock.cell for station in site.stations)}
        speeds = np.abs(simulation.world.car_speeds())
        for car, (x, y, _) in enumerate(simulation.world.car_poses()):
            cell = int(site.grid.index(*site.grid.cell_at(float(x), float(y))))
            stands = speeds[car] < STANDING_MPS and cell not in bays
            self._still_s[car] = self._still_s[car] + simulation.tick_s if stands else 0.0
        self.longest_s = max(self.longest_s, float(self._still_s.max()))
        if simulation.sim_s > LEARNT_S:
            for station in simulation.stations:
                passing = self._still_s[bookings.place_of != station.arm]
                known = self.longest_passing_s.get(station.arm, 0.0)
                self.longest_passing_s[station.arm] = max(known, float(passing.max(initial=0.0)))
        self.most = max(self.most, *(len(bookings.cars(station.arm)) for station in simulation.stations))
        roster = simulation.missions
        for phase, task in zip(roster.phase, roster.task_of, strict=True):
            if task is not None and phase in (CarPhase.TO_PICK, CarPhase.TO_DROP):
                assert " is held: " not in task.reason, "who goes on is not held any more"
        tails, ahead = simulation.executor.tail_states(), simulation.executor.granted_states()
        for station in simulation.stations:
            near = simulation.traffic.tables.to(station.dock_state)[ahead] <= NEAR_MOVES
            come = {
                car
                for car, goal in enumerate(simulation.traffic.goals)
                if goal == station.dock_state
                and near[car]
                and roster.phase[car] in (CarPhase.TO_PICK, CarPhase.TO_DROP)
            }
            there = set(np.flatnonzero(tails == station.dock_state).tolist())
            unbooked = come - set(bookings.cars(station.arm))
            before = self._unbooked_s.get(station.arm, {})
            self._unbooked_s[station.arm] = {car: before.get(car, 0.0) + simulation.tick_s for car in unbooked}
            longest_s = max(self._unbooked_s[station.arm].values(), default=0.0)
            assert longest_s <= CALL_S + simulation.tick_s, "who comes near has a booking or turns aside"
            assert len((come - unbooked) | there) <= simulation.config.allocation.station_cap_n + 1, (
                "but for one that passes"
            )


def run(arm: str | None, seed: int, cap: int = 2) -> tuple[Summary, list[Event], Watch]:
    parameters = {"factor": 1 / 3, "duration_s": 1e6}
    slow = ScenarioEvent(time_s=0.0, kind="arm_slow", target=arm or "arm_0", parameters=parameters)
    config = RunConfig(
        robots=6,
        tasks=24,
        seed=seed,
        duration_s=900.0,
        fidelity=Fidelity.KINEMATIC,
        events=(slow,) if arm else (),
        arms=ArmConfig(workers_n=0),
        allocation=AllocationConfig(station_cap_n=cap),
    )
    log: list[Event] = []
    watch = Watch(config.robots)
    with Simulation(config, on_event=log.append) as simulation:
        simulation.run(watch.look)
        return simulation.summary(), log, watch


@pytest.mark.parametrize(("arm", "station"), [("arm_2", "drop_1"), ("arm_0", "pick_1")])
@pytest.mark.parametrize("seed", [0, 1])
def test_an_arm_that_is_three_times_as_slow(arm: str, station: str, seed: int) -> None:
    """Cars are held upstream, aisles stay open, and the report names the arm."""
    summary, log, watch = run(arm, seed)
    assert summary.tasks_done == summary.tasks_total
    assert watch.most <= 2
    assert watch.longest_s < SLOW_SERVICE_S, "nobody waits in a lane for more than one transfer"
    assert watch.longest_passing_s[int(arm[-1])] < SLOW_SERVICE_S / 2, "nor does one that only passes the slow station"
    held = [str(event.facts["cause"]) for event in log if event.kind == "held"]
    assert sum(station in cause for cause in held) >= 2
    assert f"; {station} ({arm}): busy " in summary.bottleneck
    slow = summary.stations[station]
    assert slow.service_mean_s > 2.0 * min(report.service_mean_s for report in summary.stations.values())


def test_with_the_largest_cap_cars_queue_in_the_lanes() -> None:
    """The same run shows what the booking is good for."""
    _, _, watch = run("arm_2", seed=0, cap=4)
    assert watch.most > 3


def test_the_time_of_every_car_is_accounted_for() -> None:
    log: list[Event] = []
    config = RunConfig(fidelity=Fidelity.GRID, robots=4, tasks=6, arms=ArmConfig(workers_n=0))
    with Simulation(config, on_event=log.append) as simulation:
        simulation.run()
        summary = simulation.summary()
        ticks = [sum(vars(time).values()) for time in summary.car_ticks.values()]
        assert ticks == [simulation.now] * 4
    assert round(10 * sum(summary.time_share_percent.values())) == 1000
