"""The calibrate command: damping and friction of an arm from a measured motion."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import tyro
from rich.table import Table

from fleet.cli.run_output import plain_console
from fleet.config import require
from fleet.outputs import require_file_below, require_other
from fleet.whole_file import write_whole

if TYPE_CHECKING:
    import numpy as np

    from fleet.control.friction_fit import FrictionFit
    from fleet.world.bullet.bench.replay import Drive

FIRST_DAMPING, FIRST_FRICTION = 0.5, 0.1
"""What the fit begins with: the damping of the usual arm's description [N m s/rad], and little dry friction [N m]."""
POOR_RAD = 0.02
"""An error that stays above this has another cause than friction."""


@dataclass(frozen=True, kw_only=True)
class Calibrate:
    """Replay a measured joint motion and fit damping and friction of the joints."""

    trajectory: Annotated[Path, tyro.conf.Positional]
    """CSV file: time [s], q1 to qn [rad], and optionally the set-points sent to the arm, target1 to targetn [rad]."""
    arm: str = "iiwa"
    """The arm: iiwa, panda, xarm, or the path of a URDF, SDF or MJCF file."""
    drive: Literal["auto", "targets", "follow", "released"] = "auto"
    """What the motors did: targets led the arm along the file's set-points, follow did so along the measured positions,
    released carried its weight only; auto finds out."""
    frequency: float = 20.0
    """Natural frequency of the arm's joint control [rad/s]."""
    out: Path | None = None
    """JSON file for the figures."""

    def run(self) -> int:
        """Fit, print and write; bad input raises."""
        import numpy as np

        from fleet.control.friction_fit import fit_friction
        from fleet.control.joint_file import check_recording, read_recording
        from fleet.stations.arms.arm_spheres import cache_dir
        from fleet.world.bullet.bench.replay import Drive, MotionReplay, drive_of, open_bench

        require(math.isfinite(self.frequency) and self.frequency > 0, "--frequency", self.frequency, "a number > 0")
        bench = open_bench(self.arm, cache_dir())
        try:
            recording = read_recording(self.trajectory, bench.drive.n)
            check_recording(self.trajectory, recording, bench.drive.limits)
            drive = drive_of(recording, bench) if self.drive == "auto" else Drive(self.drive)
            replay = MotionReplay(bench, recording, drive, self.frequency)
            require_file_below("--out", self.out)
            require_other("--out", self.out, self.trajectory)
            console = plain_console()
            console.print(
                f"{self.trajectory}: {len(recording.t)} rows, {recording.t[-1]:.2f} s, {bench.drive.n} joints; "
                f"motors: {drive.value}",
                soft_wrap=True,
            )
            with console.status("") as status:
                fit = fit_friction(
                    replay.run,
                    recording.q,
                    np.full(bench.drive.n, FIRST_DAMPING),
                    np.full(bench.drive.n, FIRST_FRICTION),
                    progress=lambda number, error: status.update(
                        f"round {number}: error {1e3 * float(np.sqrt(np.mean(error**2))):.3f} mrad"
                    ),
                )
        finally:
            bench.close()
        console.print(_table(fit))
        for line in _remarks(fit, drive):
            console.print(line, soft_wrap=True)
        if self.out is not None:
            self.out.parent.mkdir(parents=True, exist_ok=True)
            write_whole(self.out, json.dumps(_figures(self, fit, drive), indent=2) + "\n")
            console.print(f"{self.out}: the figures", soft_wrap=True)
        return 0


def _table(fit: FrictionFit) -> Table:
    table = Table(title="root mean square error and friction of each joint")
    for name in ("joint", "before [mrad]", "after [mrad]", "damping [N m s/rad]", "friction [N m]"):
        table.add_column(name, justify="right")
    for i in range(len(fit.damping)):
        table.add_row(
            str(i + 1),
            f"{1e3 * fit.rms_before_rad[i]:.3f}",
            f"{1e3 * fit.rms_rad[i]:.3f}",
            _with_sigma(fit.damping[i], fit.damping_sigma[i]),
            _with_sigma(fit.friction[i], fit.friction_sigma[i]),
        )
    return table


def _with_sigma(value: float, sigma: float) -> str:
    return f"{value:.4f} ± {sigma:.4f}" if math.isfinite(sigma) else f"{value:.4f} (the motion does not tell)"


def _remarks(fit: FrictionFit, drive: Drive) -> list[str]:
    remarks = []
    if drive.value == "follow":
        remarks.append(
            "The file names no set-points, so the measured positions stand for them: the error shows how well the arm "
            "tracks, but its friction cannot be told; add columns target1 to targetn, or record a released arm."
        )
    if fit.rms_rad.max() > POOR_RAD:
        remarks.append(
            f"Joint {int(fit.rms_rad.argmax()) + 1} stays {1e3 * fit.rms_rad.max():.0f} mrad off: damping and friction "
            "do not explain this motion; check --drive and --frequency."
        )
    return remarks


def _figures(command: Calibrate, fit: FrictionFit, drive: Drive) -> dict[str, object]:
    def numbers(values: np.ndarray) -> list[float | None]:
        return [float(value) if math.isfinite(value) else None for value in values]

    return {
        "trajectory": str(command.trajectory),
        "arm": command.arm,
        "drive": drive.value,
        "frequency_radps": command.frequency,
        "rms_before_rad": numbers(fit.rms_before_rad),
        "rms_rad": numbers(fit.rms_rad),
        "damping_nms_per_rad": numbers(fit.damping),
        "damping_sigma": numbers(fit.damping_sigma),
        "friction_nm": numbers(fit.friction),
        "friction_sigma": numbers(fit.friction_sigma),
        "replays": fit.n_replays,
    }
