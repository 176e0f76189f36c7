"""Named instances that several test folders share, each with a word on what it is good for."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from fleet.simulation import Simulation
    from maps.site import Site

# Bad input to the recorder is an error in tests, where a run would only warn.
os.environ.setdefault("RERUN_STRICT", "1")

REPOSITORY = Path(__file__).resolve().parent.parent
LONG = (
    "tests/architecture/test_extend.py",
    "tests/contract/test_cars_on_lanes.py",
    "tests/contract/test_envs.py",
    "tests/contract/test_foreign_lanes.py",
    "tests/contract/test_mixed_warehouse.py",
    "tests/guide",
    "tests/integration/test_arm_workers.py",
    "tests/integration/test_asked_in_turn.py",
    "tests/integration/test_booking.py",
    "tests/integration/test_bridge.py",
    "tests/integration/test_camera_picking.py",
    "tests/integration/test_charging.py",
    "tests/integration/test_connect_modes.py",
    "tests/integration/test_demo_ends.py",
    "tests/integration/test_demo_planar.py",
    "tests/integration/test_disturbances.py",
    "tests/integration/test_export_command.py",
    "tests/integration/test_huskies.py",
    "tests/integration/test_imported_sites.py",
    "tests/integration/test_mixed_runs.py",
    "tests/integration/test_mqtt.py",
    "tests/integration/test_pod_orders.py",
    "tests/integration/test_replay_command.py",
    "tests/integration/test_safety_check.py",
    "tests/integration/test_scale_commands.py",
    "tests/integration/test_study_command.py",
    "tests/integration/test_tiled_runs.py",
    "tests/integration/test_twin.py",
    "tests/integration/test_two_way.py",
    "tests/integration/test_unlike_arms.py",
    "tests/integration/test_unlike_cars.py",
    "tests/integration/test_walkers.py",
    "tests/integration/test_yard.py",
    "tests/interop",
    "tests/unit/benchmarks",
    "tests/unit/fleet/cli/test_lorr.py",
    "tests/unit/fleet/world/test_tiled.py",
    "tests/zoo",
)
"""Files and folders of the tests that play whole runs and pages; `make test-long` has them."""


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark what stands in `LONG`."""
    for item in items:
        path = item.path.relative_to(REPOSITORY).as_posix()
        if any(path == one or path.startswith(f"{one}/") for one in LONG):
            item.add_marker("long")


@pytest.fixture(autouse=True)
def accounts_of_every_run(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Check, whatever else a test is about, what holds at the end of each of its runs.

    The time accounts add up to robots x duration, and phases and tasks of cars go together.
    """
    if (module := sys.modules.get("fleet.simulation")) is None:
        yield
        return
    from fleet.insight.causes import Column

    made: list[Simulation] = []
    make = module.Simulation.__init__

    def keep(simulation: Simulation, *args: object, **kwargs: object) -> None:
        make(simulation, *args, **kwargs)
        made.append(simulation)

    monkeypatch.setattr(module.Simulation, "__init__", keep)
    yield
    for simulation in made:
        if hasattr(simulation, "missions"):  # else its making was refused
            assert simulation.missions.faults() == [], "a car's phase and its task do not go together"
    for simulation in filter(lambda simulation: simulation.counts_figures, made):
        time_accounts, ticks = simulation.metrics.time_accounts, simulation.now
        assert (time_accounts.robots.sum(axis=0) == ticks).all(), "a robot has more or less time than the run"
        log = simulation.causes.log
        assert (log.since(0)[:, 2 + Column.BY] < log.n_robots).all(), "a robot waits for one that there is not"
        spent = time_accounts.robots.sum(axis=1)
        for blamed in (time_accounts.by_robot, time_accounts.by_cell, time_accounts.by_place):
            assert (blamed.sum(axis=1) == spent).all(), "an account is blamed for more or less than it holds"


@pytest.fixture(scope="session")
def repository() -> Path:
    """Return the root of the source tree."""
    return REPOSITORY


@pytest.fixture(scope="session")
def cell_site() -> Site:
    """Return one pick and one drop station and little else: whole deliveries in the least time."""
    from maps.site import load_site

    return load_site("cell")


@pytest.fixture(scope="session")
def small_site() -> Site:
    """Return shelves, aisles and two stations of each kind: cars meet, queue and choose."""
    from maps.site import load_site

    return load_site("small")


@pytest.fixture(scope="session")
def medium_site() -> Site:
    """Return six stations of each kind and room for a fleet: congestion, load sharing, scale."""
    from maps.site import load_site

    return load_site("medium")
