"""Parcels in the real physics: an arm picks, the car drives, another arm unloads; share delivered, slip, cycle."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np

from benchmarks.harness import Kind, Row, Trial
from fleet.config import ArmConfig, Grip, RunConfig
from fleet.insight.slip import Slip
from fleet.simulation import Simulation
from fleet.stations.arms.arm_controller import ArmController, ArmPhase
from fleet.stations.service_time import Direction

SITE, N_CARS = "cell", 3
N_RUNS, N_FAST_RUNS = 10, 2
"""Runs of one seed each; those with faster arms are there for the cycle."""
N_PARCELS, QUICK_PARCELS = 20, 1
"""Parcels of one run."""
FAST_RADPS, FAST_RADPS2 = 3.0, 12.0
"""Limits of the faster arms: those that the targets of their cycle were measured with."""
SLIP_MM = {Grip.SUCTION: 0.1, Grip.FRICTION: 5.0}
CYCLE_S = {Grip.SUCTION: 7.4, Grip.FRICTION: 9.3}
FAST_CYCLE_S = {Grip.SUCTION: 6.1, Grip.FRICTION: 7.7}


@dataclass(kw_only=True)
class Delivered:
    """What became of the parcels of one run."""

    done: int = 0
    total: int = 0
    dropped: int = 0
    repeated: int = 0
    slips: list[Slip] = field(default_factory=list)
    pick_s: list[float] = field(default_factory=list)
    """From the start of an arm at rest at home until it is there again, for each parcel it put into a tray [s]."""
    unload_s: list[float] = field(default_factory=list)
    """The same for parcels from the tray to the rack."""


def measure_grasp(trial: Trial) -> Iterable[Row]:
    """Random parcels of 5 to 8 cm and 0.1 to 0.5 kg, with each grip; fast arms once more for their cycle."""
    for grip in Grip:
        usual, quick = Delivered(), Delivered()
        for run in range(1 if trial.quick else N_RUNS):
            deliver(trial, grip, trial.seeds[0] + run, ArmConfig(), usual)
        fast = ArmConfig(velocity_radps=FAST_RADPS, acceleration_radps2=FAST_RADPS2)
        for run in range(1 if trial.quick else N_FAST_RUNS):
            deliver(trial, grip, trial.seeds[0] + run, fast, quick)
        slip_mm = [1e3 * slip.slip_m for slip in usual.slips]
        share = 100 * usual.done / usual.total
        yield Row(name=f"{grip}: {usual.total} parcels delivered", value=share, unit="%", target=">= 99")
        yield Row(name="  parcels dropped on the way", value=usual.dropped, unit="")
        yield Row(name="  transfers tried again", value=usual.repeated, unit="")
        yield Row(name="  slip in the grip, median", value=float(np.median(slip_mm)), unit="mm")
        yield Row(name="  slip, most", value=max(slip_mm), unit="mm", target=f"<= {SLIP_MM[grip]}")
        most_mm = max(1e3 * slip.most_m for slip in usual.slips)
        yield Row(name="  slip, most at any moment", value=most_mm, unit="mm")
        turn = np.degrees(max(slip.turn_rad for slip in usual.slips))
        yield Row(name="  turn in the grip, most", value=float(turn), unit="deg")
        cycle_s = float(np.median(usual.pick_s))
        yield Row(
            name="  cycle, rack to tray, median", value=cycle_s, unit="s", kind=Kind.PLAIN, target=f"<= {CYCLE_S[grip]}"
        )
        yield Row(name="  most", value=max(usual.pick_s), unit="s", kind=Kind.PLAIN)
        yield Row(
            name="  cycle, tray to rack, median", value=float(np.median(usual.unload_s)), unit="s", kind=Kind.PLAIN
        )
        share = 100 * quick.done / quick.total
        yield Row(name=f"{grip} at {FAST_RADPS:g} rad/s: {quick.total} delivered", value=share, unit="%")
        cycle_s = float(np.median(quick.pick_s))
        yield Row(
            name="  cycle, rack to tray, median",
            value=cycle_s,
            unit="s",
            kind=Kind.PLAIN,
            target=f"<= {FAST_CYCLE_S[grip]}",
        )
        slip_mm = [1e3 * slip.slip_m for slip in quick.slips]
        yield Row(name="  slip, most", value=max(slip_mm), unit="mm")


def deliver(trial: Trial, grip: Grip, seed: int, arms: ArmConfig, found: Delivered) -> None:
    """Run a site until its parcels are delivered, check what must hold for every parcel, and add to what was found."""
    n_parcels = QUICK_PARCELS if trial.quick else N_PARCELS
    config = RunConfig(
        site=SITE,
        robots=N_CARS,
        tasks=n_parcels,
        seed=seed,
        grip=grip,
        arms=arms,
        duration_s=100.0 * n_parcels,
    )
    repeated: list[object] = []
    with Simulation(
        config, on_event=lambda event: repeated.append(event) if event.kind == "transfer_repeated" else None
    ) as simulation:
        begun: dict[int, int] = {}
        while not simulation.finished:
            simulation.tick()
            for service in simulation.arm_manager.services:
                _watch(simulation, service, begun, found)
        summary = simulation.summary()
        meter = simulation.figures.slip_meter
        slips = list(meter.slips) if meter is not None else []
    found.total += n_parcels
    found.done += summary.tasks_done
    found.dropped += summary.parcels_dropped
    found.repeated += len(repeated)
    found.slips += slips
    where = f"{grip}, seed {seed}"
    # Of two carries for each parcel, the rack's and the tray's, none may be left out.
    carries = f"{where}: {len(slips)} carries of {summary.tasks_done} parcels"
    trial.check(len(slips) >= 2 * summary.tasks_done, carries)
    trial.check(summary.parcel_balance == 0, f"{where}: {summary.parcel_balance} parcels are lost")
    trial.check(summary.parcels_misplaced == 0, f"{where}: {summary.parcels_misplaced} parcels are misplaced")
    trial.check(summary.robot_contacts == 0, f"{where}: {summary.robot_contacts} contacts between robots")


def _watch(simulation: Simulation, service: ArmController, begun: dict[int, int], found: Delivered) -> None:
    """Note when an arm sets out, and how long it took when it is back."""
    arm = service.arm
    if service.state is ArmPhase.MOVING:
        begun.setdefault(arm, simulation.now)
    elif service.state is ArmPhase.IDLE and arm in begun:
        took_s = (simulation.now - begun.pop(arm)) * simulation.tick_s
        to_car = simulation.stations[arm].direction is Direction.TO_CAR
        (found.pick_s if to_car else found.unload_s).append(took_s)
