"""Why a run is over: a loop in Python is told what the command line says."""

import pytest

from fleet import simulation
from fleet.config import Fidelity, RunConfig, ScenarioEvent
from fleet.run.ending import Ending

LOST = ScenarioEvent(time_s=1.0, kind="plans_lost", target="fleet", parameters={"duration_s": 3000.0})
"""The planner answers nothing any more."""


@pytest.mark.parametrize(
    ("own", "ending"),
    [
        ({"tasks": 1}, Ending.DONE),
        ({"duration_s": 2.0}, Ending.TIME_UP),
        ({"events": (LOST,)}, Ending.STALLED),
    ],
)
def test_a_run_says_why_it_is_over(own: dict[str, object], ending: Ending, monkeypatch: pytest.MonkeyPatch) -> None:
    """A friction of the first hour: a run that came to a stand ended without a word."""
    monkeypatch.setattr(simulation, "STALL_S", 20.0)
    config = RunConfig(site="cell", robots=1, fidelity=Fidelity.GRID, **own)  # type: ignore[arg-type]
    with simulation.Simulation(config) as run:
        assert run.ending is None
        assert run.run() is ending is run.ending
