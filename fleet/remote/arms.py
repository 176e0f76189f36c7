"""RemoteArms: arms that somebody outside of the fleet moves, over docks that are closed meanwhile."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass

import numpy as np

from fleet.arrays import FloatArray
from fleet.remote.errors import RemoteError
from fleet.robots.arms.spec import ArmSpec
from fleet.run.view import RunView
from fleet.stations.arms.arm_controller import ArmPhase
from planners.motion.arm.kinematics import link_frames, turn_about_z

LOW_M = 0.6
"""Over a lane, an arm must keep its joints and its tip higher than this above the floor: cars with parcels [m]."""
LOOK_RAD = 0.05
"""Between joint positions at which a motion is looked at [rad]."""
STEP_RAD = 0.05
"""How far from where the arm is the first point of a motion may be that is due at once [rad]."""
HOME_RAD = 0.01
_IN_OTHER_HANDS = "is in other hands"
RETRY_S = 1.0
"""Between two attempts to find the way home [s]."""


@dataclass(kw_only=True)
class _Grasp:
    """What is known of an arm in other hands."""

    trusted: bool
    """Whether it may reach over lanes."""
    given: bool = False
    """Whether the fleet has handed it over."""
    leaves: bool = False
    """Whether it is on its way home, and back into the hands of the fleet."""
    retry_s: float = 0.0
    times_s: FloatArray | None = None
    """Of the points of its motion, since it began, shape (k,); None = it goes to the one point there is."""
    points: FloatArray | None = None
    """Joint positions [rad], shape (k, n_joints); None = it stands."""
    begun_s: float = 0.0


class RemoteArms:
    """Arms in other hands.

    The station of such an arm is closed, and what the arm is about comes to its end first; what it is told meanwhile
    begins then. From then on nobody is let into its dock, and the arm stays inside the limits of its joints. It comes
    home, by a way that is planned, before the station opens again.

    Args:
        run: The run.
    """

    def __init__(self, run: RunView) -> None:
        self._run = run
        self._grasps: dict[int, _Grasp] = {}

    @property
    def taken(self) -> list[int]:
        """Arms in other hands."""
        return list(self._grasps)

    def take(self, arm: int, *, trusted: bool = False) -> None:
        """Let somebody else move an arm, as soon as it has ended what it is about.

        Args:
            arm: The arm.
            trusted: Whether it may reach over lanes.
        """
        if arm in self._grasps:
            self._grasps[arm].trusted, self._grasps[arm].leaves = trusted, False
            return
        self._run.dispatcher.rules.interventions.close_station(arm, self._run.sim_s, _IN_OTHER_HANDS, for_good=False)
        self._grasps[arm] = _Grasp(trusted=trusted)

    def follow(self, arm: int, times_s: object, points: object) -> None:
        """Let an arm that was taken go through points at their times, in straight lines between them.

        Args:
            arm: The arm.
            times_s: Of the points, from now, shape (k,), ascending.
            points: Joint positions [rad], shape (k, n_joints).

        Raises:
            RemoteError: It was not taken, or cannot move like that; names joint, value and limits.
        """
        grasp = self._grasp(arm)
        points, times = self._points(arm, points), _floats(times_s)
        if times.shape != (len(points),) or not np.isfinite(times).all() or times[0] < 0 or (np.diff(times) <= 0).any():
            raise RemoteError(f"arm_{arm}: times {times.tolist()}; valid: {len(points)} ascending numbers >= 0")
        start = self._start(arm, grasp)
        if times[0] == 0.0 and np.abs(points[0] - start).max() > STEP_RAD:
            raise RemoteError(f"arm_{arm}: first point at once, {STEP_RAD} rad away or more; valid: a time to go there")
        if times[0] > 0.0:
            points, times = np.vstack((start, points)), np.concatenate(([0.0], times))
        if len(points) > 1:
            speeds = np.abs(np.diff(points, axis=0)) / np.diff(times)[:, None]
            over = speeds - self._spec.max_velocity_radps
            if over.max() > 1e-9:
                k, joint = np.unravel_index(int(np.argmax(over)), over.shape)
                most = float(self._spec.max_velocity_radps[joint])
                raise RemoteError(
                    f"arm_{arm}: joint_{joint + 1} at {speeds[k, joint]:.3f} rad/s; valid: at most {most:.3f}"
                )
        self._check_reach(arm, grasp, np.vstack((start, points)))
        grasp.times_s, grasp.points, grasp.begun_s = times, points, self._run.sim_s

    def aim(self, arm: int, target: object) -> None:
        """Let an arm that was taken go to joint positions, as fast as its limits allow; the newest target counts.

        Args:
            arm: The arm.
            target: Joint positions [rad], shape (n_joints,).

        Raises:
            RemoteError: It was not taken, or cannot be there; names joint, value and limits.
        """
        grasp = self._grasp(arm)
        points = self._points(arm, [target])
        self._check_reach(arm, grasp, np.vstack((self._start(arm, grasp), points)))
        grasp.times_s, grasp.points = None, points

    def give_back(self, arm: int) -> None:
        """Let the fleet have an arm again, as soon as it is home."""
        grasp = self._grasps.get(arm)
        if grasp is not None:
            grasp.leaves, grasp.points = True, None

    def tick(self) -> None:
        """Move the arms in other hands on by one tick."""
        for arm, grasp in list(self._grasps.items()):
            if not grasp.given:
                self._hand_over(arm, grasp)
            elif grasp.leaves:
                self._bring_home(arm, grasp)
            elif self._run.arm_manager.rests(arm):
                self._move(arm, grasp)
            else:
                grasp.begun_s = self._run.sim_s  # taken again on its way home, which it ends first

    def _hand_over(self, arm: int, grasp: _Grasp) -> None:
        """Take an arm that has ended what it was about, or leave it with the fleet if nobody wants it any more."""
        run = self._run
        if grasp.leaves:
            self._release(arm)
        elif run.arm_manager.services[arm].state is ArmPhase.HOLDING and run.missions.served[arm] < 0:
            run.arm_manager.put_back(arm)  # fetched for a car that will not come
        elif run.arm_manager.is_idle(arm) and run.executor.close_if_free(self._dock(arm), for_a_moment=True):
            run.arm_manager.hand_over(arm)
            grasp.given, grasp.begun_s = True, run.sim_s
            run.events.log("remote_taken", robot=f"arm_{arm}", trusted=grasp.trusted)

    @property
    def _spec(self) -> ArmSpec:
        """Model of the arms, which are all alike.

        Raises:
            ConfigError: They are not.
        """
        return self._run.scene.arms.only("arms in other hands")

    def _bring_home(self, arm: int, grasp: _Grasp) -> None:
        run = self._run
        at_home = np.abs(run.arm_manager.q[arm] - self._spec.home_rad).max() < HOME_RAD
        if not run.arm_manager.rests(arm):
            return
        if at_home:
            run.arm_manager.take_back(arm)
            run.executor.open(self._dock(arm))
            self._release(arm)
        elif run.sim_s >= grasp.retry_s:
            run.arm_manager.come_home(arm, run.now)
            grasp.retry_s = run.sim_s + RETRY_S

    def _release(self, arm: int) -> None:
        del self._grasps[arm]
        self._run.dispatcher.rules.interventions.open_station(arm, _IN_OTHER_HANDS)
        self._run.events.log("remote_given_back", robot=f"arm_{arm}")

    def _move(self, arm: int, grasp: _Grasp) -> None:
        run, manager, spec = self._run, self._run.arm_manager, self._spec
        if grasp.points is None:
            manager.qd[arm] = 0.0
        elif grasp.times_s is not None:
            since_s = run.sim_s + run.tick_s - grasp.begun_s
            goal = np.array([np.interp(since_s, grasp.times_s, grasp.points[:, k]) for k in range(spec.n_joints)])
            manager.qd[arm] = (goal - manager.q[arm]) / run.tick_s
            manager.q[arm] = goal
            if since_s > grasp.times_s[-1] + run.tick_s:
                grasp.points = None
        else:
            left = grasp.points[0] - manager.q[arm]
            gain = spec.max_acceleration_radps2 * run.tick_s
            # From the fastest of which it can still stop in whole ticks: v^2 + v gain = 2 acceleration left.
            stops = np.sqrt(gain**2 / 4 + 2 * spec.max_acceleration_radps2 * np.abs(left)) - gain / 2
            fastest = np.minimum(spec.max_velocity_radps, stops)
            speed = np.clip(np.sign(left) * fastest, manager.qd[arm] - gain, manager.qd[arm] + gain)
            arrives = np.abs(left) <= np.abs(speed) * run.tick_s
            manager.q[arm] = np.where(arrives, grasp.points[0], manager.q[arm] + speed * run.tick_s)
            manager.qd[arm] = np.where(arrives, 0.0, speed)

    def _grasp(self, arm: int) -> _Grasp:
        grasp = self._grasps.get(arm)
        if grasp is None or grasp.leaves:
            raise RemoteError(f"arm_{arm} is in the hands of the fleet; valid: an arm that was taken")
        return grasp

    def _start(self, arm: int, grasp: _Grasp) -> FloatArray:
        """Where a motion begins: where the arm is, or will be when it is handed over."""
        here = grasp.given and self._run.arm_manager.rests(arm)
        return self._run.arm_manager.q[arm] if here else self._spec.home_rad

    def _points(self, arm: int, points: object) -> FloatArray:
        spec = self._spec
        found = _floats(points)
        if found.ndim != 2 or not len(found) or found.shape[1] != spec.n_joints or not np.isfinite(found).all():
            raise RemoteError(
                f"arm_{arm}: points of shape {found.shape}; valid: rows of {spec.n_joints} finite numbers"
            )
        beyond = np.maximum(spec.lower_rad - found, found - spec.upper_rad)
        if beyond.max() > 1e-9:
            k, joint = np.unravel_index(int(np.argmax(beyond)), beyond.shape)
            raise RemoteError(
                f"arm_{arm}: joint_{joint + 1} is {found[k, joint]:.4f} rad; "
                f"valid: {spec.lower_rad[joint]:.4f} to {spec.upper_rad[joint]:.4f}"
            )
        return found

    def _check_reach(self, arm: int, grasp: _Grasp, points: FloatArray) -> None:
        """Refuse a motion that comes down over a lane."""
        if grasp.trusted:
            return
        looks = [
            start
            + np.linspace(0.0, 1.0, 2 + math.ceil(float(np.abs(end - start).max()) / LOOK_RAD))[:, None] * (end - start)
            for start, end in itertools.pairwise(points)
        ]
        grid = self._run.site.grid
        places = self._places(arm, np.concatenate(looks))
        row = grid.rows - 1 - np.floor(places[:, 1] / grid.cell_m).astype(np.int64)
        col = np.floor(places[:, 0] / grid.cell_m).astype(np.int64)
        on_floor = (row >= 0) & (row < grid.rows) & (col >= 0) & (col < grid.cols)
        cell = np.where(on_floor, row * grid.cols + col, self._dock(arm))
        bad = (places[:, 2] < LOW_M) & grid.free.ravel()[cell] & (cell != self._dock(arm))
        if bad.any():
            first = int(np.argmax(bad))
            raise RemoteError(
                f"arm_{arm} would come down to {places[first, 2]:.2f} m over the lane in {row[first]},{col[first]}; "
                f"valid: from {LOW_M} m on, or a client that is trusted"
            )

    def _places(self, arm: int, q: FloatArray) -> FloatArray:
        """Joints beyond the base, and the tip, in the world at some positions (k, n_joints), shape (m, 3) [m]."""
        spec = self._spec
        frames = link_frames(spec.base_from_joint, q)
        tips = frames[:, -1] @ np.array([0.0, 0.0, spec.tool_length_m, 1.0])
        local = np.concatenate((frames[:, 1:, :3, 3].reshape(-1, 3), tips[:, :3]))
        x, y, z, yaw = self._run.scene.arm_base[arm].tolist()
        return np.array([x, y, z]) + local @ turn_about_z(yaw).T

    def _dock(self, arm: int) -> int:
        return int(self._run.graph.state_cell[self._run.stations[arm].dock_state])


def _floats(values: object) -> FloatArray:
    """Numbers as an array; an empty one if they are none, or rows of different lengths."""
    try:
        return np.array(values, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        return np.empty(0)
