"""Situations: runs in which it is known, because they are staged, why a robot waits, and when.

What holds at a time is read from the state of the run by rules that share nothing with `fleet.insight`: an arm's pace,
a cell that is blocked, who has died.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from fleet.config import (
    ArmConfig,
    BatteryConfig,
    CarConfig,
    Fidelity,
    RunConfig,
    ScenarioEvent,
    TrafficConfig,
)
from fleet.insight.causes import NO_WAIT, Cause
from fleet.insight.explain import Explanation
from fleet.insight.phrases import Link
from fleet.missions.phases import CarPhase
from fleet.simulation import Simulation

STILL_S = 0.5
"""A robot that has stood this long while its situation holds must be explained by it [s]."""
AFTER_S = 1.0
"""So long after the situation is over its root may still be named: the fleet looks again every half second [s]."""
STILL_MPS = 0.05
NEXT_M = 1.3
"""Cars that are nearer than this stand in one row: cells are 1 m [m]."""

MEETING_M = 9.0
"""Cars that are nearer than this and go to each other's half meet in the corridor: it is driven one way at a time, so
one waits at an end while the other comes to the corridor and through it [m]."""

CORRIDOR = '''
name = "corridor"
allow_reverse = true
plan = """
################
#......##......#
#.KKK..##..KKK.#
#.....xxxx.....#
_......##......_
AP.....##.....DA
_......##......_
#......##......#
################
"""
'''
"""Two halves of a floor with one two-way corridor between them."""


@dataclass(frozen=True, kw_only=True)
class Situation:
    """A staged wait."""

    summary: str
    settings: dict[str, object]
    """Fields of `RunConfig`."""
    holds: Callable[[Simulation, int], bool]
    """Whether it holds now for a robot, by its number."""
    is_root: Callable[[Explanation], bool]
    """Whether an explanation names the true root."""
    robots: tuple[str, ...]
    """Who may be caught in it."""
    may_hold: Callable[[Simulation, int], bool] | None = None
    """Where `holds` is sure of a part only: whether the root may be named now; None = only while it holds."""
    orders: str = ""
    """Lines of an order file."""
    site: str = ""
    """Text of a site file."""

    def config(self, folder: Path) -> RunConfig:
        """Write the files it needs and return the settings."""
        chosen = dict(self.settings)
        if self.orders:
            path = folder / "orders.csv"
            path.write_text(self.orders.strip() + "\n", encoding="utf-8")
            chosen["orders"] = path
        if self.site:
            path = folder / "site.toml"
            path.write_text(self.site.strip() + "\n", encoding="utf-8")
            chosen["site"] = str(path)
        # With PIBT a car keeps moves while a plan is made, so that it waits for others and not for plans.
        traffic = TrafficConfig(planner="pibt")
        base = RunConfig(fidelity=Fidelity.KINEMATIC, traffic=traffic, arms=ArmConfig(workers_n=0))
        return replace(base, **chosen)  # type: ignore[arg-type]


@dataclass(kw_only=True)
class Verdict:
    """How well explanations have named the root of a situation."""

    n_held: int = 0
    """Pairs of a robot and a tick in which a robot had stood for `STILL_S` and its situation held."""
    n_named: int = 0
    """Those of them that were explained by the true root."""
    n_early: int = 0
    """Explanations by this root before the situation had begun for the robot."""
    n_late: int = 0
    """The same more than `AFTER_S` after it was over."""
    over: bool = False
    """Whether it was over before the run was, for some robot."""
    said: dict[str, str] = field(default_factory=dict)
    """What was said last of each robot."""
    missed: list[str] = field(default_factory=list)
    """What was said instead, the first few."""


def play(situation: Situation, folder: Path) -> Verdict:
    """Run a situation and ask in every tick why the robots wait."""
    verdict = Verdict()
    with Simulation(situation.config(folder)) as simulation:
        still_s = dict.fromkeys(situation.robots, 0.0)
        last_s: dict[str, float] = {}
        while not simulation.finished:
            simulation.tick()
            for name in situation.robots:
                robot = simulation.codebook.robot(name)
                holds = situation.holds(simulation, robot)
                still_s[name] = still_s[name] + simulation.tick_s if holds and _stands(simulation, robot) else 0.0
                if holds or (situation.may_hold is not None and situation.may_hold(simulation, robot)):
                    last_s[name] = simulation.sim_s
                elif name in last_s:
                    verdict.over = True
                _judge(verdict, situation, simulation.explain(name), still_s[name], last_s.get(name))
    return verdict


def _judge(verdict: Verdict, situation: Situation, said: Explanation, still_s: float, last_s: float | None) -> None:
    """Count one explanation; `last_s` is when the situation last held for the robot."""
    named = situation.is_root(said)
    if named:
        verdict.said[said.robot] = str(said)
        verdict.n_early += last_s is None
        verdict.n_late += last_s is not None and said.time_s > last_s + AFTER_S
    if still_s >= STILL_S:
        verdict.n_held += 1
        verdict.n_named += named
        if not named and len(verdict.missed) < 5:
            verdict.missed.append(f"{said.time_s:.2f} s: {said}")


def _stands(simulation: Simulation, robot: int) -> bool:
    speeds = simulation.world.car_speeds()
    return robot >= len(speeds) or abs(float(speeds[robot])) < STILL_MPS


def _event(time_s: float, kind: str, target: str, **parameters: float) -> ScenarioEvent:
    return ScenarioEvent(time_s=time_s, kind=kind, target=target, parameters=parameters)


def _phase(simulation: Simulation, car: int) -> CarPhase:
    return simulation.missions.phase[car]


def _is_cut_off(simulation: Simulation, car: int) -> bool:
    """Whether car_0 is dead, and another has not got past it."""
    return _phase(simulation, 0) is CarPhase.DEAD and _phase(simulation, car) is not CarPhase.TO_DROP


def _bound_for(simulation: Simulation, car: int, arm: int) -> bool:
    """Whether a car is to be served by an arm, and is not yet."""
    waits = _phase(simulation, car) in (CarPhase.TO_PICK, CarPhase.TO_DROP, CarPhase.HELD)
    return waits and int(simulation.missions.bookings.place_of[car]) == arm


_FIELDS = "id,release_s,pick,drop,mass_kg,size_m,needs\n"


def _deliveries(n: int, pick: str = "pick_1", drop: str = "drop_1", needs: str = "", release_s: float = 1.0) -> str:
    """Lines of an order file: as many like deliveries."""
    return "".join(f"{pick}_{drop}_{k},{release_s:g},{pick},{drop},0.3,0.06,{needs}\n" for k in range(n))


def _moves(*moves: tuple[float, str, str]) -> str:
    """An order file of cars that are sent to places: time, car, place."""
    return "id,type,release_s,places,needs\n" + "".join(f"to_{at},move,{s:g},{at},{car}\n" for s, car, at in moves)


def _is_blocked(simulation: Simulation, row: int, col: int) -> bool:
    return bool(simulation.traffic.blocked[simulation.site.grid.index(row, col)])


def _meets_head_on(simulation: Simulation, car: int) -> bool:
    """Both cars are to go through the corridor, the other one moves, and this one may not."""
    moves = abs(float(simulation.world.car_speeds()[1 - car])) > STILL_MPS
    return _may_meet(simulation, car) and moves and simulation.executor.dependencies.n_granted(car) == 0


def _may_meet(simulation: Simulation, car: int) -> bool:  # noqa: ARG001 - asked of one car, true of both
    apart_m = abs(float(np.subtract(*simulation.world.car_poses()[:, 0])))
    both = all(_phase(simulation, one) is CarPhase.TO_PLACE for one in (0, 1))
    return both and apart_m < MEETING_M


def _is_ready_to_drop(simulation: Simulation, car: int) -> bool:
    """Whether a car stands at the drop dock, not served yet."""
    dock = simulation.stations[1].dock_state
    there = int(simulation.executor.tail_states()[car]) == dock and simulation.executor.idle(car)
    return there and _phase(simulation, car) is CarPhase.TO_DROP


def _is_behind_queue(simulation: Simulation, car: int) -> bool:
    """A car bound for the other pick station stands in a row of cars that ends at the slow arm, which is at work."""
    if not _may_be_behind_queue(simulation, car) or _phase(simulation, car) is not CarPhase.TO_PICK:
        return False
    served, poses = int(simulation.missions.served[0]), simulation.world.car_poses()
    if served < 0 or _phase(simulation, served) is not CarPhase.LOADING:
        return False
    row = [car]
    for one in row:
        away_m = np.hypot(*(poses - poses[one])[:, :2].T)
        row += [other for other in np.flatnonzero(away_m < NEXT_M).tolist() if other not in row]
    return served in row and all(_stands(simulation, other) for other in row)


def _may_be_behind_queue(simulation: Simulation, car: int) -> bool:
    """A car is on its way to the other pick station while the slow arm is at work, or on its way home."""
    works = not simulation.arm_manager.is_idle(0) and simulation.arm_manager.services[0].speed < 1.0
    return works and _bound_for(simulation, car, 1)


def _is_slow_arm(root: Link) -> bool:
    return root.robot == "arm_0" and root.cause is Cause.WORKS and root.detail == "slow"


SITUATIONS: dict[str, Situation] = {
    "blocked lane": Situation(
        summary="a box stands in the only way to the drop dock",
        settings={"site": "cell", "robots": 1, "duration_s": 60.0}
        | {"events": (_event(14.0, "lane_blocked", "4,10", duration_s=20.0),)},
        orders=_FIELDS + _deliveries(1),
        robots=("car_0",),
        holds=lambda simulation, car: _is_blocked(simulation, 4, 10) and _phase(simulation, car) is CarPhase.TO_DROP,
        is_root=lambda said: said.root.cause is Cause.BLOCKED and said.root.cell == (4, 10),
    ),
    "dead car": Situation(
        summary="a car dies at the only pick dock",
        settings={"site": "cell", "robots": 3, "duration_s": 40.0} | {"events": (_event(7.0, "car_dead", "car_0"),)},
        orders=_FIELDS + _deliveries(6),
        robots=("car_1", "car_2"),
        holds=lambda simulation, car: (
            # Who has just been sent elsewhere waits for a plan.
            _is_cut_off(simulation, car) and simulation.traffic.landed_goals[car] == simulation.traffic.goals[car]
        ),
        may_hold=_is_cut_off,
        is_root=lambda said: said.root.robot == "car_0" and said.root.detail == "dead",
    ),
    "slow arm": Situation(
        summary="the pick arm works at a tenth of its pace",
        settings={"site": "cell", "robots": 3, "duration_s": 75.0}
        | {"events": (_event(7.5, "arm_slow", "arm_0", factor=0.1, duration_s=20.0),)},
        orders=_FIELDS + _deliveries(3),
        robots=("car_1", "car_2"),
        holds=lambda simulation, car: simulation.arm_manager.services[0].speed < 1.0 and _bound_for(simulation, car, 0),
        is_root=lambda said: _is_slow_arm(said.root),
    ),
    "dead arm": Situation(
        summary="the pick arm stands still while it serves a car, until it is repaired",
        settings={"site": "cell", "robots": 3, "duration_s": 75.0}
        | {"events": (_event(7.5, "arm_dead", "arm_0", duration_s=20.0),)},
        orders=_FIELDS + _deliveries(3),
        robots=("car_1", "car_2"),
        holds=lambda simulation, car: (
            bool(simulation.arm_manager.dead[0])
            and _stands(simulation, car)
            and simulation.executor.dependencies.n_granted(car) == 0
        ),
        may_hold=lambda simulation, car: bool(simulation.arm_manager.dead[0]),
        is_root=lambda said: (
            (said.root.robot, said.root.cause, said.root.detail) == ("arm_0", Cause.FAULT, "dead")
            and said.release == "arm_0 has to be repaired"
        ),
    ),
    "full dock": Situation(
        summary="the parcels on the slots of the drop station are not collected",
        settings={"site": "cell", "robots": 3, "duration_s": 125.0, "collect_after_s": 80.0},
        orders=_FIELDS + _deliveries(6),
        robots=("car_1", "car_2"),
        holds=lambda simulation, car: (
            _phase(simulation, car) is CarPhase.TO_DROP
            and simulation.stations[1].n_free == 0
            and any(_is_ready_to_drop(simulation, other) for other in range(3))
        ),
        is_root=lambda said: said.root.cause is Cause.SLOT and said.root.place == "drop_1",
    ),
    "low battery": Situation(
        summary="two cars with low batteries share one charger",
        settings={"site": "small", "robots": 2, "duration_s": 70.0}
        | {"battery": BatteryConfig(enabled=True, start=0.14, capacity_wh=2.0, chargers_n=1)},
        orders=_FIELDS + _deliveries(2),
        robots=("car_1",),
        holds=lambda simulation, car: (
            _phase(simulation, 0) is CarPhase.CHARGING and _phase(simulation, car) is CarPhase.IDLE
        ),
        is_root=lambda said: (
            (said.root.robot, said.root.cause, said.root.place) == ("car_0", Cause.CHARGES, "charger_1")
        ),
    ),
    "head-on meeting": Situation(
        summary="two cars come from both ends of a corridor with room for one",
        settings={"robots": 2, "duration_s": 60.0},
        site=CORRIDOR,
        orders=_moves((1.0, "car_1", "parking_6"), (26.0, "car_0", "parking_5"), (25.0, "car_1", "parking_2")),
        robots=("car_0", "car_1"),
        holds=_meets_head_on,
        may_hold=_may_meet,
        is_root=lambda said: said.waits and said.root.robot != said.robot and said.root.cause in NO_WAIT,
    ),
    "missing capability": Situation(
        summary="the only open task needs what one busy car alone can do",
        settings={"site": "small", "robots": 3, "duration_s": 60.0}
        | {"cars": {"car_0": CarConfig(capabilities=("cold",))}},
        orders=_FIELDS + _deliveries(1, needs="cold") + _deliveries(1, "pick_2", "drop_2", needs="cold"),
        robots=("car_1", "car_2"),
        holds=lambda simulation, car: (
            _phase(simulation, car) is CarPhase.IDLE
            and any(task.order.name == "pick_2_drop_2_0" and task.state == "ready" for task in simulation.board.tasks)
        ),
        is_root=lambda said: (said.root.detail, said.root.task) == ("lacks_capability", "pick_2_drop_2_0"),
    ),
    "late planner": Situation(
        summary="plans land eight seconds after they are asked for",
        settings={"site": "small", "robots": 1, "duration_s": 60.0, "traffic": TrafficConfig(latency_s=8.0)},
        orders=_moves((1.0, "car_0", "parking_5")),
        robots=("car_0",),
        holds=lambda simulation, car: (
            _phase(simulation, car) is CarPhase.TO_PLACE
            and simulation.executor.dependencies.n_queued(car) + simulation.executor.dependencies.n_granted(car) == 0
            and int(simulation.executor.tail_states()[car]) != int(simulation.traffic.goals[car])
        ),
        is_root=lambda said: said.root.cause is Cause.PLAN_LATE,
    ),
    "unreachable goal": Situation(
        summary="a box stands in the only way to the pick dock",
        settings={"site": "cell", "robots": 1, "duration_s": 45.0}
        | {"events": (_event(2.0, "lane_blocked", "2,1", duration_s=20.0),)},
        orders=_FIELDS + _deliveries(1, release_s=4.0),
        robots=("car_0",),
        holds=lambda simulation, car: (
            _is_blocked(simulation, 2, 1) and any(task.state == "ready" for task in simulation.board.tasks)
        ),
        is_root=lambda said: (said.root.detail, said.root.cell) == ("no_way", (2, 1)),
    ),
    "queue spill": Situation(
        summary="cars queue for a slow arm into the aisle, and keep one that only wants to pass",
        settings={"site": "small", "robots": 6, "duration_s": 90.0}
        | {"events": (_event(6.0, "arm_slow", "arm_0", factor=0.15, duration_s=60.0),)},
        orders=_FIELDS + _deliveries(4) + _deliveries(4, "pick_2", "drop_2", release_s=4.0),
        robots=tuple(f"car_{car}" for car in range(6)),
        holds=_is_behind_queue,
        may_hold=_may_be_behind_queue,
        is_root=lambda said: said.chain[0].place == "pick_2" and said.waits and _is_slow_arm(said.root),
    ),
}
"""Situations by name."""
