"""Measurement: a row of a study tells what the run itself tells."""

from __future__ import annotations

from pathlib import Path

import pytest

from fleet.config import ArmConfig, Fidelity, RunConfig, StreamConfig, StreamKind
from fleet.simulation import Simulation
from fleet.study.measurement import measure, run_whole_time


@pytest.mark.parametrize("fidelity", [Fidelity.GRID, Fidelity.KINEMATIC])
def test_figures_are_those_of_the_run(fidelity: Fidelity) -> None:
    """Tardiness was 45 s in a study and 60 s in the very same run."""
    stream = StreamConfig(kind=StreamKind.POISSON, rate_per_h=300.0)
    arms = ArmConfig(workers_n=0)
    config = RunConfig(site="small", robots=2, stream=stream, duration_s=600.0, fidelity=fidelity, arms=arms)
    row = measure(config)
    with Simulation(config) as simulation:
        run_whole_time(simulation)
        told = simulation.summary()
    assert row.tardiness_s is not None
    assert (row.task_time_s, row.task_time_p95_s) == (told.task_time_mean_s, told.task_time_p95_s)
    assert (row.tardiness_s, row.on_time_share) == (told.tardiness_mean_s, told.on_time_share)
    assert (row.throughput_per_h, row.state_hash) == (told.throughput_per_h, told.state_hash)
    assert row.bound_cars_per_h == (told.bounds and told.bounds.cars_per_h)


def test_deliveries_have_no_bounds_beside_visits(tmp_path: Path) -> None:
    """A study said that 1200 % of what could be delivered at most was."""
    orders = tmp_path / "orders.csv"
    orders.write_text("id,type,release_s,pick,drop,mass_kg,size_m,places\na,delivery,1,pick_1,drop_1,0.3,0.06,\n")
    only = measure(RunConfig(site="small", robots=2, orders=orders, duration_s=120.0, fidelity=Fidelity.GRID))
    orders.write_text(orders.read_text() + "b,inspect,1,,,,,parking_1\n")
    both = measure(RunConfig(site="small", robots=2, orders=orders, duration_s=120.0, fidelity=Fidelity.GRID))
    assert (only.done, both.done) == (1, 2)
    assert only.bound_cars_per_h is not None
    assert both.bound_cars_per_h is None
