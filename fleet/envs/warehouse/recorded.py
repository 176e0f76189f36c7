"""Recording: an episode as a rerun file, written while it is played."""

from __future__ import annotations

from pathlib import Path

from fleet.envs.warehouse.run.agent_simulation import AgentSimulation
from fleet.recording import OutputError
from fleet.session.frames import Watch, open_recorder


class Recording:
    """Records one run, tick by tick.

    Args:
        simulation: The run.
        path: File to write; its folder is made.

    Raises:
        OutputError: The folder cannot be made.
        RecordingError: The file cannot be opened.
    """

    def __init__(self, simulation: AgentSimulation, path: Path) -> None:
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
        except OSError as reason:
            raise OutputError(f"folder {path.parent} cannot be made: {reason}") from reason
        self._recorder = open_recorder(simulation.view, path)
        self._watch = Watch(simulation.view, simulation.figures, self._recorder)
        simulation.events.subscribe(self._watch.note)

    def look(self) -> None:
        """Record the present tick."""
        self._watch.look()

    def close(self) -> None:
        """Finish the file; calling twice is harmless."""
        self._recorder.close()
