"""The command that fits the kinematic model of a robot."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated

import tyro
from rich.table import Table

from fleet.cli.run_output import PLAIN_WIDTH, plain_console
from fleet.config import require
from fleet.errors import ConfigError
from fleet.outputs import require_folder
from fleet.whole_file import write_whole
from maps.reading.near import hint

DONE = 0


@dataclass(frozen=True, kw_only=True)
class RobotFit:
    """Fit the kinematic model of a robot to its physics; prints the values of its file beside the fitted ones."""

    name: Annotated[str, tyro.conf.Positional]
    """One that is told a speed and a yaw rate; for cars that steer see `fit`."""
    load: float = 0.0
    """Mass of a parcel in its tray [kg]."""
    seed: int = 0
    """Of the commands and of the sensors' errors; the same seed gives the same numbers."""
    out: Path = Path("runs/robots")
    """Directory for the figures, a JSON file."""

    def run(self) -> int:
        """Drive, fit, print and write."""
        require(self.seed >= 0, "--seed", self.seed, "an integer >= 0")
        from fleet.robots.twist import TWIST_ROBOTS

        if self.name not in TWIST_ROBOTS:
            valid = ", ".join(TWIST_ROBOTS)
            raise ConfigError(f"robot {self.name!r}{hint(self.name, list(TWIST_ROBOTS))}; valid: {valid}")
        spec = TWIST_ROBOTS[self.name]()
        most = spec.max_payload_kg
        require(0.0 <= self.load <= most, "--load", self.load, f"a number from 0 to {most:g} with {self.name}")
        require_folder("--out", self.out)
        from fleet.proving.fit import fit_response

        console = plain_console(columns=PLAIN_WIDTH)
        with console.status("driving in physics"):
            fit = fit_response(spec, seed=self.seed, load_kg=self.load)
        table = Table(title=f"how the {self.name} answers a speed and a yaw rate")
        for heading in ("parameter", "in its file", "from physics"):
            table.add_column(heading, justify="left" if heading == "parameter" else "right", no_wrap=True)
        for name, stated in vars(fit.stated).items():
            table.add_row(name, f"{stated:.4g}", f"{getattr(fit.fitted, name):.4f} ± {fit.sigma[name]:.4f}")
        for k, what in enumerate(("error of the speed, rms [m/s]", "error of the yaw rate, rms [rad/s]")):
            table.add_row(what, f"{fit.stated_rms[k]:.4f}", f"{fit.fitted_rms[k]:.4f}")
        console.print(table)
        self.out.mkdir(parents=True, exist_ok=True)
        path = self.out / f"{self.name}_fit.json"
        settings = {"robot": self.name, "load_kg": self.load, "seed": self.seed}
        write_whole(path, json.dumps(settings | asdict(fit), indent=2) + "\n")
        console.print(f"{path}: the figures; the robot's file is as it was", soft_wrap=True)
        return DONE
