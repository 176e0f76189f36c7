"""Every setting that may change during a run reaches the parts that go by it."""

from dataclasses import replace
from typing import Any

import pytest

from fleet.config import CHANGEABLE, ArmConfig, Fidelity, RunConfig, SettingChange
from fleet.simulation import Simulation
from planners.allocation import ALLOCATORS
from planners.errors import PlanningError
from planners.mapf import PLANNERS

CHANGED_S = 1.0
VALUES: dict[str, Any] = {
    "allocation.allocator": "greedy",
    "allocation.allocator_settings": ("nearest_n", 9),
    "traffic.planner": "pibt",
    "traffic.planner_settings": ("impatience", 2),
    "allocation.keep_share": 0.5,
    "traffic.grant_moves_n": 2,
}
"""Other values than the usual ones; numbers that are not named here become 3."""
USUAL = RunConfig(site="cell", robots=1, tasks=1, fidelity=Fidelity.GRID, duration_s=5.0, arms=ArmConfig(workers_n=0))


def held(simulation: Simulation) -> dict[str, Any]:
    """What the parts go by."""
    allocation = simulation.view.assignments.allocation
    interventions = simulation.dispatcher.rules.interventions
    return {
        "allocation": [
            part._config
            for part in (allocation._solver, allocation._cost_model, allocation._horizon, allocation._offers)
        ],
        "traffic": [simulation.traffic._config, simulation.executor._config],
        "timeouts": [interventions._limits],
    }


@pytest.mark.parametrize("name", CHANGEABLE)
def test_a_change_reaches_all_who_go_by_it(name: str) -> None:
    value = VALUES.get(name, 3)
    name, value = (f"{name}.{value[0]}", value[1]) if isinstance(value, tuple) else (name, value)
    change = SettingChange(time_s=CHANGED_S, name=name, value=value)
    heard: list[Any] = []
    with Simulation(replace(USUAL, changes=(change,)), on_event=heard.append) as simulation:
        allocator, planner = simulation.view.assignments.allocation._solver._allocator, simulation.traffic._planner
        while simulation.sim_s < CHANGED_S:
            simulation.tick()
        for group, configs in held(simulation).items():
            assert all(config == getattr(USUAL, group) for config in configs)
        simulation.tick()
        later = simulation.config.as_of(CHANGED_S)
        assert later != USUAL
        for group, configs in held(simulation).items():
            assert all(config == getattr(later, group) for config in configs)
        new_allocator = simulation.view.assignments.allocation._solver._allocator is not allocator
        new_planner = simulation.traffic._planner is not planner
        assert (new_allocator, new_planner) == (".allocator" in name, ".planner" in name)
        assert isinstance(
            simulation.view.assignments.allocation._solver._allocator, ALLOCATORS[later.allocation.allocator]
        )
        assert isinstance(simulation.traffic._planner, PLANNERS[later.traffic.planner])
        assert simulation.traffic._period == round(later.traffic.period_s / simulation.tick_s)
        assert simulation.traffic._latency == round(later.traffic.latency_s / simulation.tick_s)
    assert [event.facts for event in heard if event.kind == "setting_changed"] == [{"setting": name, "value": value}]


def test_a_name_that_there_is_not_is_refused_before_the_run() -> None:
    for name in ("allocation.allocator", "traffic.planner"):
        with pytest.raises(PlanningError, match="nobody"):
            Simulation(replace(USUAL, changes=(SettingChange(time_s=3.0, name=name, value="nobody"),)))
