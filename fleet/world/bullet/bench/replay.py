"""MotionReplay: a simulated arm repeats what a real one was measured to do."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path

import numpy as np

from fleet.arrays import FloatArray
from fleet.control import ControlError, JointLimits, gains_from_mass, pd_torque
from fleet.control.joint_file import JointRecording
from fleet.robots.arms import ARMS
from fleet.world.bullet.bench.arm_file import ArmFileError, read_arm
from fleet.world.bullet.bench.bench import ArmBench

FREQUENCY_RADPS = 20.0
"""Natural frequency of the joint control that is taken for the real arm's, unless said otherwise."""
ROTOR_KGM2 = 0.1
"""Inertia of a motor behind its gear, for the gains of light joints: a harmonic drive of 100 to 160 with a rotor of
some 1e-5 kg m^2 has 0.1 to 0.3."""
BRAKING_RADPS2 = 5.0
"""Deceleration before end stops, for arms whose file says nothing about it."""
_FIRST_ROWS = 10
"""Rows from which the first velocity is taken."""
_MOST_CHECKED = 200
_RISE = 0.05
"""Kinetic energy that rises by more than this part of its greatest value comes from a motor."""


class Drive(StrEnum):
    """What the motors did while a motion was recorded."""

    TARGETS = "targets"
    """Joint control led the arm along the set-points that the recording names."""
    FOLLOW = "follow"
    """Joint control led the arm, but the set-points are unknown: the measured positions stand for them."""
    RELEASED = "released"
    """The motors carried the arm's weight only: it was moving and came to rest by itself."""


def open_bench(arm: str, cache_dir: Path | None = None) -> ArmBench:
    """A bench with a named arm, or with one from a file.

    Args:
        arm: A name in `ARMS`, with the real arm's limits; or a path, with the file's.
        cache_dir: Directory for fitted collision spheres; None fits anew.

    Raises:
        ArmFileError: No such arm, or its file cannot be used.
    """
    if arm in ARMS:
        kind = ARMS[arm]
        frozen = None if kind.hand is None else kind.hand.open_at
        file = read_arm(kind.urdf, frozen=frozen, cache_dir=cache_dir)
        velocity, torque, braking = (
            np.array(limits) for limits in (kind.max_velocity_radps, kind.max_torque_nm, kind.max_acceleration_radps2)
        )
    else:
        if not Path(arm).suffix:
            raise ArmFileError(f"arm {arm!r}; valid: {', '.join(ARMS)}, or a .urdf, .sdf or .xml file")
        file = read_arm(Path(arm), cache_dir=cache_dir)
        velocity, torque = file.max_velocity_radps, file.max_torque_nm
        braking = np.full(len(velocity), BRAKING_RADPS2)
    limits = JointLimits(
        lower_rad=file.model.lower,
        upper_rad=file.model.upper,
        max_velocity_radps=velocity,
        max_torque_nm=torque,
        braking_radps2=braking,
    )
    return ArmBench(file, limits)


def drive_of(recording: JointRecording, bench: ArmBench) -> Drive:
    """What the motors did, from what was recorded.

    Without set-points, an arm whose kinetic energy never rose was released.
    """
    if recording.target is not None:
        return Drive.TARGETS
    rows = np.unique(np.linspace(0, len(recording.t) - 2, _MOST_CHECKED).astype(int))
    speed = np.diff(recording.q, axis=0) / np.diff(recording.t)[:, None]
    energy = np.array([0.5 * speed[k] @ bench.dynamics.mass_matrix(recording.q[k]) @ speed[k] for k in rows])
    rise = float((energy - np.minimum.accumulate(energy)).max())
    return Drive.FOLLOW if rise > _RISE * float(energy.max()) else Drive.RELEASED


class MotionReplay:
    """Repeats one motion on a bench, with any friction.

    Args:
        bench: The arm.
        recording: The motion; it begins where its first row says, with the velocity of its first rows.
        drive: What the motors do.
        frequency_radps: Natural frequency of the joint control; its gains are those of the mass matrix at the start.

    Raises:
        ControlError: Set-points are wanted and the recording has none, or it has another number of joints.
    """

    def __init__(
        self, bench: ArmBench, recording: JointRecording, drive: Drive, frequency_radps: float = FREQUENCY_RADPS
    ) -> None:
        if recording.q.shape[1] != bench.drive.n:
            raise ControlError(f"recording of {recording.q.shape[1]} joints for an arm of {bench.drive.n}")
        if drive is Drive.TARGETS and recording.target is None:
            raise ControlError("drive targets: the recording has no set-points; valid: follow, released")
        self._bench, self._recording, self._drive = bench, recording, drive
        first = min(_FIRST_ROWS, len(recording.t))
        self._start_qd = np.polyfit(recording.t[:first], recording.q[:first], 3)[-2]
        self._gains = gains_from_mass(
            bench.dynamics.mass_matrix(recording.q[0]), frequency_radps, rotor_kgm2=ROTOR_KGM2
        )
        n_steps = int(np.ceil(recording.t[-1] / bench.step_s)) + 1
        self._times: FloatArray = np.arange(n_steps + 1, dtype=np.float64) * bench.step_s
        wanted = recording.target if drive is Drive.TARGETS else recording.q
        if wanted is None:
            raise ControlError("drive targets: the recording has no set-points")
        self._target = _columns(self._times, recording.t, wanted)

    def run(self, damping: FloatArray, friction: FloatArray) -> FloatArray:
        """Repeat the motion with a friction; gives the joint positions at the recorded times, shape (k, n) [rad]."""
        bench, step_s, target = self._bench, self._bench.step_s, self._target
        drive, dynamics = bench.drive, bench.dynamics
        drive.set_friction(damping, friction)
        drive.place(self._recording.q[0], self._start_qd)
        still = np.zeros(drive.n)
        path: list[FloatArray] = [self._recording.q[0]]
        for k in range(len(self._times) - 1):
            now = drive.sense()
            weight = dynamics.bias(now.q, still)
            if self._drive is Drive.RELEASED:
                drive.torque(weight, now)
            else:
                rate = (target[k + 1] - target[k]) / step_s
                error = target[k + 1] - now.q - step_s * now.qd
                drive.torque(pd_torque(self._gains, now.mass, now.bias, weight, error, rate - now.qd, step_s), now)
            bench.step()
            path.append(drive.state()[0])
        return _columns(self._recording.t, self._times, np.array(path, dtype=np.float64))


def _columns(at: FloatArray, t: FloatArray, values: FloatArray) -> FloatArray:
    """Linear interpolation of each column of values (k, n) at times; shape (m, n)."""
    return np.column_stack([np.interp(at, t, column) for column in values.T])
