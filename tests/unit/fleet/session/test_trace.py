"""Tracer: what a killed run leaves of its trace lacks half a second at most, and is there from the start."""

from pathlib import Path

import pytest

from fleet.config import WHOLE, ArmConfig, Fidelity, RunConfig
from fleet.recording import RecordingError
from fleet.recording.run_file import EVENTS
from fleet.recording.trace_file import TRACE, read_trace
from fleet.session import SessionConfig, run_session
from fleet.session.trace import Tracer
from fleet.simulation import Simulation


def config(fidelity: Fidelity) -> RunConfig:
    return RunConfig(site="cell", robots=1, fidelity=fidelity, arms=ArmConfig(workers_n=0))


@pytest.mark.parametrize("fidelity", WHOLE)
def test_no_more_than_half_a_second_is_not_yet_written(fidelity: Fidelity, tmp_path: Path) -> None:
    with Simulation(config(fidelity)) as simulation, Tracer(simulation.view, tmp_path, "name") as tracer:
        for tick in range(1, 100):
            simulation.tick()
            tracer.tick()
            written = read_trace(tmp_path).n_ticks
            assert tick - 0.5 / simulation.tick_s <= written <= tick
    assert read_trace(tmp_path).n_ticks == 99


def test_a_run_that_is_killed_while_its_recording_is_opened_has_a_trace(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refused(*_: object, **__: object) -> None:
        assert {path.name for path in tmp_path.iterdir()} == {EVENTS, TRACE}
        raise RecordingError("it is not opened")

    monkeypatch.setattr("fleet.session.runner.open_recorder", refused)
    with pytest.raises(RecordingError, match="it is not opened"):
        run_session(config(Fidelity.GRID), SessionConfig(out=tmp_path, progress=False))
