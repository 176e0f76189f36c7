"""Bare loop: what a whole fleet costs, by the loop that one writes by hand around PyBullet in the same scene.

The loop is given what the robots of the fleet were told, tick by tick, and makes as many physics steps; it has no
orders, plans, traffic, estimates, contacts or figures. It solves as training does, half as exactly as a fleet; what
that saves is told by a loop that solves as a fleet.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass, field

from benchmarks.harness import Kind, Row, Trial
from benchmarks.scale.medium_fleet import CARS, SITE, medium_fleet
from benchmarks.training.bare import BareLoop
from fleet.arrays import BoolArray, FloatArray
from fleet.config import Fidelity, RunConfig
from fleet.simulation import Simulation
from fleet.world.bullet.engine.config import BulletConfig

WARM_S, SIM_S, QUICK_SIM_S = 5.0, 60.0, 5.0
"""Simulated time before the measurement, and of it [s]."""
PAIRS = 2
"""Runs of each, in turn; the least counts."""


@dataclass(kw_only=True)
class _Told:
    """What robots were told, tick by tick."""

    cars: list[FloatArray] = field(default_factory=list)
    arms: list[FloatArray] = field(default_factory=list)


def measure_bare_loop(trial: Trial) -> Iterator[Row]:
    """A fleet of 20 cars with physics, by the hand-written loop."""
    sim_s = QUICK_SIM_S if trial.quick else SIM_S
    config = medium_fleet(trial, Fidelity.PHYSICS, WARM_S + sim_s)
    fleets, loops, engines, exact_loops = [], [], [], []
    for _ in range(PAIRS):
        told = _Told()
        fleets.append(_fleet_s(config, told) / sim_s)
        loop_s, engine_s = _loop_s(config, told, None)
        loops.append(loop_s / sim_s)
        engines.append(engine_s / sim_s)
        exact_loops.append(_loop_s(config, told, BulletConfig())[0] / sim_s)
    where = f"{CARS} cars on {SITE}, physics"
    yield Row(name=f"{where}: a simulated second", value=1000.0 * min(fleets), unit="ms", kind=Kind.TIME)
    yield Row(name=f"{where}: by the hand-written loop", value=min(fleets) / min(loops), unit="", target="<= 1.4")
    yield Row(name=f"{where}: by stepSimulation alone", value=min(fleets) / min(engines), unit="")
    yield Row(name=f"{where}: by a loop that solves as exactly", value=min(fleets) / min(exact_loops), unit="")


def _fleet_s(config: RunConfig, told: _Told) -> float:
    """Computing time of a run after the first seconds; notes what its robots are told [s]."""
    with Simulation(config) as simulation:
        step = simulation.world.step

        def noted(car_commands: FloatArray, arm_q: FloatArray, arm_qd: FloatArray, grip: BoolArray) -> None:
            told.cars.append(car_commands.copy())
            told.arms.append(arm_qd.copy())
            step(car_commands, arm_q, arm_qd, grip)

        simulation.world.step = noted  # type: ignore[method-assign]
        while simulation.sim_s < WARM_S:
            simulation.tick()
        begin = time.process_time()
        while not simulation.finished:
            simulation.tick()
        return time.process_time() - begin


def _loop_s(config: RunConfig, told: _Told, solver: BulletConfig | None) -> tuple[float, float]:
    """Computing time of the loop for the same ticks, and of its physics steps alone [s]."""
    usual = BulletConfig()
    with Simulation(config) as simulation:
        scene = simulation.scene
    loop = BareLoop(scene, CARS, 0, usual.n_substeps, like_fleet=True, physics_hz=1.0 / usual.substep_s, solver=solver)
    n_warm = round(WARM_S / usual.tick_s)
    begin = engine_s = 0.0
    for tick, (cars, arms) in enumerate(zip(told.cars, told.arms, strict=True)):
        if tick == n_warm:
            begin, engine_s = time.process_time(), loop.engine_s
        wheels = cars.copy()
        wheels[:, 1] /= scene.car.wheel_radius_m
        loop.step(wheels, arms)
    spent_s = time.process_time() - begin
    loop.close()
    return spent_s, loop.engine_s - engine_s
