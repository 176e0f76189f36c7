"""KukaReach: a gymnasium environment in which one Kuka iiwa brings the tip of its tool to a point.

An episode begins with the arm at home. It terminates with success at the first step at whose end the tip is within 5 cm
of the goal; the arm need not stop there. It is truncated after `max_steps` steps. Goals are drawn evenly from a ring
about the base: 0.35 to 0.75 m from its axis, within 2 rad to either side, 0.15 to 0.8 m above its foot; all of it can
be reached.

Actions: 7 joint velocities / the joints' limits, in [-1, 1].

Observations, all clipped to [-1, 1]; positions are those of the arm's base frame:

| entries | |
|---|---|
| 0-6 | joint positions, -1 = lower limit, 1 = upper limit |
| 7-13 | joint velocities / limits |
| 14-16 | tool tip / 1.5 m |
| 17-19 | goal / 1.5 m |
| 20-22 | from the tip to the goal / 0.5 m |

Rewards: 5 for each metre the tip comes nearer, 2 on reaching the goal, -0.02 per step. `infos` has `distance_m` and
`is_success`.
"""

from __future__ import annotations

import math
from typing import Any

import gymnasium
import numpy as np
import numpy.typing as npt
from gymnasium.spaces import Box
from gymnasium.utils import EzPickle
from numba import njit

from fleet.arrays import FloatArray
from fleet.config import ArmConfig, Fidelity, require
from fleet.config.field_checks import is_number, is_whole
from fleet.envs.core.choices import row_of
from fleet.robots import ARMS, ArmTeam
from fleet.robots.cars.models import usual_car
from fleet.robots.tools import TOOLS
from fleet.world.kinematic import KinematicConfig, KinematicWorld
from fleet.world.protocol import World
from fleet.world.scene import Scene
from planners.motion.arm.kinematics import joint_rows, last_link_pose

FIDELITIES = (Fidelity.PHYSICS, Fidelity.KINEMATIC)
TOLERANCE_M = 0.05
"""The goal is reached when the tip is this close [m]."""
RING_M = (0.35, 0.75)
"""Distances of goals from the arm's first axis [m]."""
SIDE_RAD = 2.0
"""Greatest angle of a goal to either side [rad]."""
HEIGHT_M = (0.15, 0.8)
"""Heights of goals above the arm's foot [m]."""
PROGRESS_PER_M, SUCCESS, STEP = 5.0, 2.0, -0.02
"""What things are worth."""
WIND_UP_RAD = 0.1
"""A joint's target runs at most this far ahead of the joint, so that a blocked arm does not wind up [rad]."""
TICK_S = 1 / 60
"""Length of a tick at either fidelity [s]."""
_FLOOR_M = 3.0

Observation = npt.NDArray[np.float32]


class KukaReachEnv(gymnasium.Env[Any, Any], EzPickle):
    """One arm that reaches for points; see the module's description.

    Args:
        fidelity: `physics` or `kinematic`.
        control_hz: Steps per simulated second; 60 is a multiple of it.
        max_steps: Steps after which an episode is truncated.
        render_mode: Only None; the arm has nothing to be drawn on.

    Raises:
        ConfigError: An argument is outside its valid range.
    """

    metadata: dict[str, Any] = {"render_modes": []}  # noqa: RUF012 - as gymnasium has it

    def __init__(
        self, fidelity: str = "physics", control_hz: float = 20.0, max_steps: int = 100, render_mode: str | None = None
    ) -> None:
        EzPickle.__init__(self, fidelity, control_hz, max_steps, render_mode)
        require(fidelity in FIDELITIES, "fidelity", fidelity, ", ".join(FIDELITIES))
        ticks = 1.0 / (control_hz * TICK_S) if is_number(control_hz) and control_hz > 0 else 0.0
        self.metadata = {**self.metadata, "render_fps": control_hz}
        self._n_ticks = round(ticks)
        fits = self._n_ticks >= 1 and math.isclose(ticks, self._n_ticks, rel_tol=1e-6)
        require(fits, "control_hz", control_hz, "60 / 1, 2, 3, ...")
        require(is_whole(max_steps) and max_steps >= 1, "max_steps", max_steps, "an integer >= 1")
        require(render_mode is None, "render_mode", render_mode, "None")
        self.render_mode = render_mode
        self.max_steps = max_steps
        spec = self._spec = ARMS.named(ArmConfig().model).spec(TOOLS["suction"])
        scene = Scene(
            size_m=(_FLOOR_M, _FLOOR_M),
            boxes=(),
            car_kinds=(usual_car(),),
            car_start=np.zeros((0, 3)),
            arms=ArmTeam.alike(spec, 1),
            arm_base=np.array([[_FLOOR_M / 2, _FLOOR_M / 2, 0.0, 0.0]]),
            arm_start=spec.home_rad[None],
        )
        self._world = _world(scene, Fidelity(fidelity))
        self._home = self._world.save(settle=True)
        self._joints = joint_rows(spec.base_from_joint)
        self._middle, self._half = (spec.upper_rad + spec.lower_rad) / 2, (spec.upper_rad - spec.lower_rad) / 2
        self._no_cars, self._no_grip = np.zeros((0, 2)), np.zeros(1, dtype=np.bool_)
        self._n_steps = -1
        self.observation_space = Box(-1.0, 1.0, (2 * spec.n_joints + 9,), np.float32)
        self.action_space = Box(-1.0, 1.0, (spec.n_joints,), np.float32)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Observation, dict[str, Any]]:
        """Begin an episode; see `gymnasium.Env.reset`."""
        super().reset(seed=seed, options=options)
        self._world.load(self._home)
        radius_m = math.sqrt(self.np_random.uniform(RING_M[0] ** 2, RING_M[1] ** 2))  # evenly over the area
        side = self.np_random.uniform(-SIDE_RAD, SIDE_RAD)
        height_m = self.np_random.uniform(*HEIGHT_M)
        self._goal = np.array([radius_m * math.cos(side), radius_m * math.sin(side), height_m])
        self._targets = self._world.arm_positions()
        self._goes_on = np.zeros_like(self._targets)
        self._n_steps = 0
        self._look()
        return self._observation(), self._info()

    def step(self, action: npt.ArrayLike) -> tuple[Observation, float, bool, bool, dict[str, Any]]:
        """Let the arm move for one control period; see `gymnasium.Env.step`.

        Raises:
            gymnasium.error.ResetNeeded: There was no `reset` yet.
            ActionError: The action is no row of seven numbers; nothing has changed.
        """
        if self._n_steps < 0:
            raise gymnasium.error.ResetNeeded("step: there was no episode yet; valid: reset() first")
        spec, before_m = self._spec, self._distance_m
        wish = row_of("the arm", action, spec.n_joints)
        wish = np.where(np.isnan(wish), 0.0, wish)
        qd = np.minimum(np.maximum(wish, -1.0), 1.0) * spec.max_velocity_radps
        for _ in range(self._n_ticks):
            q = self._world.arm_positions()[0]
            _advance(self._targets[0], self._goes_on[0], q, qd, spec.lower_rad, spec.upper_rad)
            self._world.step(self._no_cars, self._targets, self._goes_on, self._no_grip)
        self._n_steps += 1
        self._look()
        reached = self._distance_m < TOLERANCE_M
        reward = PROGRESS_PER_M * (before_m - self._distance_m) + SUCCESS * reached + STEP
        truncated = not reached and self._n_steps >= self.max_steps
        return self._observation(), float(reward), reached, truncated, self._info()

    def close(self) -> None:
        """Free what the environment holds; calling twice is harmless."""
        self._world.close()

    def _look(self) -> None:
        self._q, self._qd = self._world.arm_positions()[0], self._world.arm_velocities()[0]
        flange = last_link_pose(self._joints, self._q)
        self._tip = flange[:3, 3] + self._spec.tool_length_m * flange[:3, 2]
        self._distance_m = float(np.linalg.norm(self._goal - self._tip))

    def _observation(self) -> Observation:
        row = np.concatenate(
            (
                (self._q - self._middle) / self._half,
                self._qd / self._spec.max_velocity_radps,
                self._tip / 1.5,
                self._goal / 1.5,
                (self._goal - self._tip) / 0.5,
            )
        )
        return np.clip(row, -1.0, 1.0).astype(np.float32)

    def _info(self) -> dict[str, Any]:
        return {"distance_m": self._distance_m, "is_success": self._distance_m < TOLERANCE_M}


class ReachPolicy:
    """The scripted arm: joint velocities that bring the tip straight to the goal (damped least squares).

    Source: C. W. Wampler, "Manipulator inverse kinematic solutions based on vector formulations and damped
    least-squares methods", IEEE Trans. SMC 16(1), 1986.
    """

    def __init__(self) -> None:
        spec = self._spec = ARMS.named(ArmConfig().model).spec(TOOLS["suction"])
        self._middle, self._half = (spec.upper_rad + spec.lower_rad) / 2, (spec.upper_rad - spec.lower_rad) / 2
        self._joints = joint_rows(spec.base_from_joint)

    def actions(self, rows: Observation) -> npt.NDArray[np.float32]:
        """Actions for observations of shape (n, 23), shape (n, 7)."""
        return np.stack([self._action(row.astype(np.float64)) for row in rows]).astype(np.float32)

    def _action(self, row: FloatArray) -> FloatArray:
        n = self._spec.n_joints
        q = row[:n] * self._half + self._middle
        slopes = self._slopes(q)
        gap = (row[2 * n + 3 : 2 * n + 6] - row[2 * n : 2 * n + 3]) * 1.5
        velocity = gap * min(1.0, 0.5 / max(float(np.linalg.norm(gap)), 1e-9)) * 4.0
        qd = slopes.T @ np.linalg.solve(slopes @ slopes.T + 0.01 * np.eye(3), velocity)
        share = qd / self._spec.max_velocity_radps
        return np.asarray(share / max(1.0, float(np.abs(share).max())))

    def _slopes(self, q: FloatArray) -> FloatArray:
        """Derivative of the tip's position by the joints [m/rad], shape (3, n)."""
        step = 1e-5
        tips = [self._tip(q + step * unit) for unit in np.eye(len(q))]
        return (np.stack(tips, axis=1) - self._tip(q)[:, None]) / step

    def _tip(self, q: FloatArray) -> FloatArray:
        flange = last_link_pose(self._joints, q)
        tip: FloatArray = flange[:3, 3] + self._spec.tool_length_m * flange[:3, 2]
        return tip


@njit(cache=True)
def _advance(
    targets: FloatArray, goes_on: FloatArray, q: FloatArray, qd: FloatArray, lower: FloatArray, upper: FloatArray
) -> None:  # pragma: no cover - compiled
    """Move joint targets on by one tick; a joint that is held back by its limits does not go on beyond them."""
    for j in range(len(q)):
        wanted = min(max(targets[j] + qd[j] * TICK_S, q[j] - WIND_UP_RAD), q[j] + WIND_UP_RAD)
        targets[j] = min(max(wanted, lower[j]), upper[j])
        goes_on[j] = qd[j] if targets[j] == wanted else 0.0


def _world(scene: Scene, fidelity: Fidelity) -> World:
    if fidelity is Fidelity.PHYSICS:
        # The engine takes a moment to load and is needed by this world alone.
        from fleet.world.bullet.engine.config import BulletConfig
        from fleet.world.bullet.world import BulletWorld

        return BulletWorld(scene, BulletConfig(tick_s=TICK_S))
    return KinematicWorld(scene, KinematicConfig(tick_s=TICK_S))
