"""Noted run: `python -m fleet` that also notes when each tick was over, where a killed process leaves it.

`python -m benchmarks.reliability.noted_run NOTES demo ...`: the note is of nothing that the run itself writes, so that
what the run has left can be judged by it.
"""

from __future__ import annotations

import sys
from pathlib import Path

from benchmarks.reliability.tick_notes import TickNotes
from fleet.cli.main import main
from fleet.simulation import Simulation

if __name__ == "__main__":
    notes = TickNotes.opened(Path(sys.argv[1]))
    tick = Simulation.tick

    def noted(simulation: Simulation) -> None:
        """Tick, and note when it was over."""
        tick(simulation)
        notes.note(simulation.now, simulation.tick_s)

    Simulation.tick = noted  # type: ignore[method-assign, assignment]
    main(sys.argv[2:])
