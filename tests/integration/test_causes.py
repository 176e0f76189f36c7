"""Causes agree, tick by tick, with the state of the run that they are read from."""

import numpy as np
import pytest

from fleet.config import ArmConfig, BatteryConfig, Fidelity, RunConfig, ScenarioEvent, TrafficConfig
from fleet.insight.causes import NONE, NOT_KEPT_BY_PLACE, OWN, WITHOUT_TASK, Cause, Column
from fleet.insight.explain import Explanation
from fleet.insight.time_accounts import STANDING_MPS
from fleet.missions.phases import CarPhase
from fleet.simulation import Simulation

PIBT = TrafficConfig(planner="pibt")
AT_DOCK = (CarPhase.LOADING, CarPhase.UNLOADING)
OUT = (CarPhase.DEAD, CarPhase.RECOVERING, CarPhase.RETIRED)
BOUND = (CarPhase.TO_PICK, CarPhase.TO_DROP, CarPhase.TO_CHARGER, CarPhase.TO_PLACE)


def made(**settings: object) -> Simulation:
    chosen = {"fidelity": Fidelity.GRID, "arms": ArmConfig(workers_n=0)} | settings
    return Simulation(RunConfig(**chosen))  # type: ignore[arg-type]


BUSY = {"site": "medium", "robots": 20, "tasks": 60, "duration_s": 35.0}
TROUBLED = {"robots": 6, "tasks": 20, "duration_s": 70.0, "fidelity": Fidelity.KINEMATIC} | {
    "events": (
        ScenarioEvent(time_s=12.0, kind="car_pushed", target="car_1", parameters={"dx_m": 0.3, "dyaw_rad": 0.8}),
        ScenarioEvent(time_s=20.0, kind="arm_slow", target="arm_0", parameters={"factor": 0.3, "duration_s": 30.0}),
        ScenarioEvent(time_s=30.0, kind="lane_blocked", target="6,7", parameters={"duration_s": 20.0}),
        ScenarioEvent(time_s=5.0, kind="grip_lost", target="arm_1"),
        ScenarioEvent(time_s=45.0, kind="car_dead", target="car_3"),
    )
}
SHARED = {"site": "twin", "robots": 4, "tasks": 16, "duration_s": 80.0}
CHARGING = {"robots": 4, "tasks": 12, "duration_s": 80.0} | {
    "battery": BatteryConfig(enabled=True, start=0.2, capacity_wh=2.0, chargers_n=1)
}
ALONE = {"site": "cell", "robots": 1, "tasks": 3, "duration_s": 60.0}
CROWDED = {"robots": 10, "tasks": 30, "duration_s": 60.0}


def check(simulation: Simulation) -> None:
    """Compare the rows of the present tick with what the parts of the fleet say themselves."""
    rows, roster, n_cars = simulation.causes.rows, simulation.missions, simulation.world.n_cars
    dependencies, speeds = simulation.executor.dependencies, simulation.world.car_speeds()
    assert rows[:, Column.CAUSE].min() >= 0
    assert (rows[:, Column.BY] != np.arange(len(rows))).all(), "nobody waits for itself"
    for robot, (cause, by, cell, place, _, _, _) in enumerate(rows.tolist()):
        assert by == NONE or cause not in (Cause.DRIVES, Cause.SETS_OFF, Cause.WORKS, Cause.FAULT)
        if robot >= n_cars:
            served = int(roster.served[robot - n_cars])
            assert cause != Cause.AWAITS or by in simulation.missions.bookings.bound(robot - n_cars)
            assert cause != Cause.WORKS or served >= 0 or not simulation.arm_manager.is_idle(robot - n_cars)
            assert cause != Cause.NO_TASK or served < 0 or simulation.arm_manager.is_idle(robot - n_cars)
            continue
        phase = roster.phase[robot]
        if phase in (*BOUND, CarPhase.HELD):
            assert (cause == Cause.DRIVES) == (abs(speeds[robot]) >= STANDING_MPS)
        assert (cause == Cause.SERVED) == (phase in AT_DOCK)
        assert (cause == Cause.FAULT) == (phase in OUT)
        assert (cause == Cause.CHARGES) == (phase is CarPhase.CHARGING)
        assert cause not in WITHOUT_TASK or phase is CarPhase.IDLE
        if phase is CarPhase.IDLE and cause not in WITHOUT_TASK:
            assert cause in NOT_KEPT_BY_PLACE | {Cause.CLOSED} - {Cause.DRIVES}
            assert abs(speeds[robot]) < STANDING_MPS
        if cause == Cause.CELL:
            assert cell in dependencies.held_cells(by)
        elif cause in (Cause.TURN, Cause.YIELDS):
            assert dependencies.line(cell)[0][0] == by
        elif cause == Cause.BLOCKED:
            assert simulation.traffic.blocked[cell]
        elif cause == Cause.SERVED:
            assert (by, roster.served[place]) == (n_cars + place, robot)
            assert rows[by, Column.CAUSE] not in (Cause.AWAITS, Cause.NO_TASK)
        elif cause in (Cause.ARM, Cause.CLOSED):
            assert not simulation.arm_manager.is_idle(by - n_cars)


@pytest.mark.parametrize("settings", [BUSY, TROUBLED, SHARED, CHARGING, ALONE, CROWDED])
def test_causes_agree_with_the_run(settings: dict[str, object]) -> None:
    seen: set[int] = set()
    circles: list[Explanation] = []
    with made(**settings) as simulation:
        while not simulation.finished:
            simulation.tick()
            check(simulation)
            if simulation.now % 5 == 0:
                circles += [told for told in map(simulation.explain, simulation.codebook.robots) if told.cycle]
            seen |= set(simulation.causes.rows[:, Column.CAUSE].tolist())
        log, rows = simulation.causes.log, simulation.causes.rows
        last = log.at(simulation.now - 1)
        assert np.array_equal(np.delete(last, Column.UNTIL, axis=1), np.delete(rows, Column.UNTIL, axis=1))
    assert circles == [], "robots that go on have not waited for each other"
    assert len(seen - OWN) >= (1 if settings is ALONE else 2), "there was something to explain"


def test_a_chain_goes_on_through_a_car_without_a_task_that_is_held_up_on_its_way() -> None:
    through: set[str] = set()
    with made(site="small", robots=18, tasks=20, seed=1, duration_s=120.0, traffic=PIBT) as simulation:
        while not simulation.finished:
            simulation.tick()
            idle = {f"car_{car}" for car, phase in enumerate(simulation.missions.phase) if phase is CarPhase.IDLE}
            if simulation.now % 5 == 0:
                for robot in simulation.codebook.robots:
                    told = simulation.explain(robot, simulation.sim_s)
                    through |= {link.robot for link in told.chain[1:-1] if link.robot in idle and link.waits}
    assert through, "some car without a task was held up while another waited for it"


def test_a_run_that_is_asked_is_the_same_run() -> None:
    runs = []
    for asked in (False, True):
        with made(**TROUBLED) as simulation:
            while not simulation.finished:
                simulation.tick()
                if asked and simulation.now % 10 == 0:
                    for robot in simulation.codebook.robots:
                        str(simulation.explain(robot, simulation.sim_s / 2))
            runs.append((simulation.state_hash(), simulation.causes.log.since(0).tobytes()))
    assert runs[0] == runs[1]


def test_an_arm_needs_as_long_as_is_said() -> None:
    """What is said when a transfer begins to be played is right to a tenth of a second, at full pace and at half."""
    said: dict[int, int] = {}
    off: list[int] = []
    slow = ScenarioEvent(time_s=0.0, kind="arm_slow", target="arm_0", parameters={"factor": 0.5, "duration_s": 900.0})
    with made(site="cell", robots=2, tasks=4, fidelity=Fidelity.KINEMATIC, events=(slow,)) as simulation:
        while not simulation.finished:
            simulation.tick()
            for arm in (0, 1):
                cause, until = simulation.causes.rows[2 + arm, [Column.CAUSE, Column.UNTIL]].tolist()
                if cause == Cause.WORKS:
                    said.setdefault(arm, until)
                elif arm in said:
                    off.append(simulation.now - 1 - said.pop(arm))
    assert len(off) == 12, "of each task a fetch and two transfers"
    assert max(map(abs, off)) * simulation.tick_s <= 0.101
