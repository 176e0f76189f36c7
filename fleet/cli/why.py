"""The why command: why a robot waited, as the files of a run tell it."""

from __future__ import annotations

import json
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro
from rich.console import Console


@dataclass(frozen=True, kw_only=True)
class Why:
    """Say why a robot waited at some time of a run, or why it had no task."""

    robot: Annotated[str, tyro.conf.Positional]
    """Such as car_2 or arm_0."""
    folder: Annotated[Path, tyro.conf.Positional]
    """Directory of the run, or its run.jsonl."""
    at: float | None = None
    """Simulated time [s]; the end of the run if not given."""
    json: bool = False
    """Print the chain as JSON instead of a sentence."""

    def run(self) -> int:
        """Read, explain and print; bad input raises."""
        from fleet.insight.cause_file import read_causes
        from fleet.insight.explain import explain
        from fleet.recording.run_file import EVENTS, plain, read_run

        folder = self.folder.parent if self.folder.name == EVENTS else self.folder
        log, codebook = read_causes(read_run(folder).events, str(folder / EVENTS))
        time_s = log.end_tick * codebook.tick_s if self.at is None else self.at
        found = explain(log, codebook, self.robot, time_s)
        console = Console(file=sys.stdout, markup=False, emoji=False, highlight=False)
        if self.json:
            facts = plain(found) | {"waits": found.waits, "waited_s": found.waited_s, "release": found.release}
            for link, cause in zip(facts["chain"], found.chain, strict=True):
                link["cause"] = cause.cause.name.lower()
            console.print(json.dumps(facts, indent=2), soft_wrap=True)
            return 0
        console.print(f"at {time_s:.2f} s: {found}", soft_wrap=True)
        if found.release:
            console.print(f"what would release it: {found.release}", soft_wrap=True)
        return 0
