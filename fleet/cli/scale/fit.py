"""The fit command: the car of the kinematic world against physical cars."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from rich.table import Table

from fleet.cli.run_output import PLAIN_WIDTH, plain_console
from fleet.config import require
from fleet.outputs import require_file_below
from fleet.whole_file import write_whole

if TYPE_CHECKING:
    from fleet.scale.fit import CarFit, Checked, FitOutcome

DONE = 0
MOST_S = 3600.0
"""Longest run that is kept tick by tick [s]."""
RESIDUALS = (
    ("speed_mps", "speed [m/s]"),
    ("steering_rad", "steering [rad]"),
    ("yaw_rate_radps", "yaw rate [rad/s]"),
    ("ahead_m", "place 1 s ahead [m]"),
)


@dataclass(frozen=True, kw_only=True)
class FitCommand:
    """Fit the car of the kinematic world to physical runs; prints today's values beside the fitted ones."""

    site: str = "small"
    """Name of a shipped site or path of a site file: a fleet drives there, beside one car that drives steps."""
    robots: int = 3
    """Cars of that fleet."""
    duration: float = 60.0
    """Simulated time of its run [s]."""
    seed: int = 0
    """Of the steps and of the run; the same seed gives the same numbers."""
    out: Path = Path("runs/fit.json")
    """JSON file for the figures."""

    def run(self) -> int:
        """Drive, fit, print and write; returns the exit status."""
        require(self.robots >= 1, "--robots", self.robots, "an integer >= 1")
        require(1.0 <= self.duration <= MOST_S, "--duration", self.duration, f"a number from 1 to {MOST_S:g}")
        require(self.seed >= 0, "--seed", self.seed, "an integer >= 0")
        require_file_below("--out", self.out)
        # The engine takes a second to load: only for runs, not for --help.
        from fleet.recording.run_file import plain
        from fleet.scale.fit import fit_cars

        console = plain_console(columns=PLAIN_WIDTH)
        with console.status("driving in physics"):
            outcome = fit_cars(self.site, self.robots, self.seed, self.duration)
        name = Path(self.site).stem
        console.print(_parameters(outcome, name))
        console.print(
            "Accelerations are limits that the fleet keeps to for its parcels' sake: no driver asks a car for more, so "
            "that physics would give more changes nothing. Grip is more than the fleet asks for, too.",
            soft_wrap=True,
        )
        console.print(_errors(outcome.checked, name))
        self.out.parent.mkdir(parents=True, exist_ok=True)
        settings = {"site": self.site, "robots": self.robots, "duration_s": self.duration, "seed": self.seed}
        write_whole(self.out, json.dumps(settings | plain(outcome), indent=2) + "\n")
        console.print(f"{self.out}: the figures; the kinematic world is as it was", soft_wrap=True)
        return DONE


def _parameters(outcome: FitOutcome, site: str) -> Table:
    table = Table(title="the kinematic car, and what physical cars say it should be")
    table.add_column("parameter", no_wrap=True)
    for heading in ("today", "from steps", "less today", f"from {site}", "less today"):
        table.add_column(heading, justify="right", no_wrap=True)
    for name, today in vars(outcome.today).items():
        cells = [f"{today:.4g}" if math.isfinite(today) else "none"]
        for fit in (outcome.steps, outcome.as_driven):
            cells += [_value(fit, name), _off(fit, name, today)]
        table.add_row(name, *cells)
    return table


def _value(fit: CarFit, name: str) -> str:
    if name not in fit.sigma:
        return "as in steps"
    if not math.isfinite(fit.sigma[name]):
        return "not told"
    return f"{getattr(fit.model, name):.4f} ± {fit.sigma[name]:.4f}"


def _off(fit: CarFit, name: str, today: float) -> str:
    """The fitted value less today's, and what share of today's that is."""
    if not math.isfinite(fit.sigma.get(name, math.inf)) or not math.isfinite(today):
        return "-"
    off = getattr(fit.model, name) - today
    return f"{off:+.4f} ({off / today:+.1%})" if today else f"{off:+.4f}"


def _errors(checked: tuple[Checked, ...], site: str) -> Table:
    table = Table(title="error of the kinematic car, root mean square")
    table.add_column("drive")
    table.add_column("of")
    for heading in ("today", "from steps", f"from {site}"):
        table.add_column(heading, justify="right", no_wrap=True)
    for one in checked:
        for field, what in RESIDUALS:
            models = (one.today, one.fitted, one.as_driven)
            table.add_row(one.drive, what, *(f"{getattr(model, field):.4f}" for model in models))
    return table
