"""A safety rule that is taken away is noticed by name, in a run or a plan that is safe with it."""

from __future__ import annotations

import functools
import importlib
from pathlib import Path

import pytest

from fleet.config import RunConfig
from fleet.errors import FleetError
from fleet.safety.breach import Invariant, InvariantError
from fleet.safety.check import SafetyCheck
from fleet.simulation import Simulation
from planners.mapf.pibt import Pibt
from planners.mapf.problem import Instance
from planners.mapf.validate import breaches
from tests.integration.planted_faults import FAULTS, PLANS, RUNS, Fault


def noticed(name: str) -> str:
    """What is wrong in a run or a plan; empty if nothing is."""
    return noticed_in_run(RUNS[name]) if name in RUNS else noticed_in_plan(PLANS[name])


def noticed_in_plan(instance: Instance) -> str:
    """The first kind of conflict in the plan of an instance."""
    return next((found.kind for found in breaches(instance, Pibt(seed=1).plan(instance))), "")


def noticed_in_run(config: RunConfig) -> str:
    """What ends a checked run: the name of an invariant or of an error; empty if it comes to its end."""
    simulation = None
    try:
        simulation = Simulation(config)
        check = SafetyCheck(simulation.view)
        simulation.run(lambda _: check.tick())
    except InvariantError as error:
        if simulation is not None:
            simulation.missions.faults = lambda: []  # type: ignore[method-assign]  # broken on purpose
        return error.breach.invariant
    # A rule of one part may be kept by another part, too, or by a library that is told nonsense.
    except (FleetError, ValueError) as error:
        return type(error).__name__
    finally:
        if simulation is not None:
            simulation.close()
    return ""


@functools.cache
def noticed_without_fault(run: str) -> str:
    """The same of a run as it is."""
    return noticed(run)


@pytest.mark.parametrize("fault", FAULTS, ids=lambda fault: f"{fault.plant.__name__}-{fault.caught_by}")
def test_a_rule_that_is_taken_away_is_noticed(fault: Fault) -> None:
    assert noticed_without_fault(fault.run) == ""
    with pytest.MonkeyPatch.context() as patch:
        fault.plant(patch)
        found = noticed(fault.run)
    assert found == fault.caught_by


@pytest.mark.parametrize("fault", FAULTS, ids=lambda fault: f"{fault.plant.__name__}-{fault.caught_by}")
def test_a_rule_lives_where_it_is_said_to(fault: Fault) -> None:
    module, *names = fault.lives_in.split(".")
    found: object = importlib.import_module(module)
    for name in names:
        module = f"{module}.{name}"
        found = getattr(found, name, None) or importlib.import_module(module)


def test_every_invariant_has_a_fault() -> None:
    assert {fault.caught_by for fault in FAULTS} >= set(Invariant)


def test_the_page_lists_them(repository: Path) -> None:
    lines = (repository / "docs/planted_faults.md").read_text(encoding="utf-8").splitlines()
    rows = [line for line in lines if line.startswith("| ") and not line.startswith("| rule ")]
    assert rows == [fault.row for fault in FAULTS]
