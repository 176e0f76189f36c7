"""Playback: where all arms are in their motions, and those that only go on are moved by one kernel."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numba import njit

from fleet.arrays import BoolArray, FloatArray, IntArray
from planners.motion.path.trajectory import Trajectory, interpolate

N_FRAMES = 64
"""Ticks that are laid out at once: a motion of an arm takes one to three seconds, and a longer one is laid out anew."""
NOTHING = -1


class Playback:
    """Joints and progress of all arms.

    What happens at the ends of a motion is for its `ArmController` to say, which is asked in every tick. In between a
    motion only goes on: its frames are laid out when it has begun, one for each tick that it fills, and played from
    there until they are used up, or the parcel in the grip is another than it was.

    Attributes:
        q: Joint positions [rad], shape (n_arms, n_joints).
        qd: Joint velocities [rad/s], same shape.
        elapsed_s: How much of its present step each arm has done [s], shape (n_arms,).
        busy_s: Time each arm has spent planning and moving [s], shape (n_arms,).
        n_changes: How often its state, its step or its speed has changed, shape (n_arms,).

    Args:
        start_rad: Joint positions at the start, shape (n_arms, n_joints).
        n_joints: Joints of each arm; what stands behind them in its row never changes.
    """

    def __init__(self, start_rad: FloatArray, n_joints: Sequence[int]) -> None:
        n_arms, width = start_rad.shape
        self.q = start_rad.copy()
        self.qd = np.zeros_like(self.q)
        self.elapsed_s = np.zeros(n_arms)
        self.busy_s = np.zeros(n_arms)
        self.n_changes = np.zeros(n_arms, dtype=np.int64)
        self._n_joints = np.array(n_joints, dtype=np.int64)
        self._frames = np.zeros((n_arms, N_FRAMES, 2, width))
        self._frame_s = np.zeros((n_arms, N_FRAMES))
        self._next = np.zeros(n_arms, dtype=np.int64)
        self._end = np.zeros(n_arms, dtype=np.int64)
        self._carried = np.full(n_arms, NOTHING, dtype=np.int64)

    def joints(self, arm: int) -> tuple[FloatArray, FloatArray]:
        """Positions and velocities of an arm's own joints, as views."""
        n = int(self._n_joints[arm])
        return self.q[arm, :n], self.qd[arm, :n]

    def lay_out(self, arm: int, motion: Trajectory, speed: float, tick_s: float, carried: int) -> None:
        """Lay out the ticks that are left of a motion that has begun, but for the one in which it ends.

        Args:
            arm: The arm.
            motion: Its present step.
            speed: At which it is played.
            tick_s: Length of a tick [s].
            carried: The parcel that has to be in the grip, `NOTHING` = it does not matter.
        """
        frames, frame_s = self._frames[arm], self._frame_s[arm]
        self._next[arm] = 0
        self._end[arm] = _lay_out(motion.t, motion.q, motion.qd, speed, tick_s, self.elapsed_s[arm], frames, frame_s)
        self._carried[arm] = carried

    def change(self, arm: int) -> None:
        """Note a change of state, step or speed: nothing is laid out any more."""
        self.n_changes[arm] += 1
        self._end[arm] = self._next[arm]

    def tick(self, tick_s: float, held: IntArray, stopped: IntArray) -> BoolArray:
        """Move the arms on whose next tick is laid out.

        Args:
            tick_s: Length of the tick [s].
            held: Parcel in each arm's grip, shape (n_arms,).
            stopped: Above 0 for an arm that is to stand still, shape (n_arms,).

        Returns:
            Which arms were moved, shape (n_arms,).
        """
        moved = np.zeros(len(self.q), dtype=np.bool_)
        _play(
            self._frames,
            self._frame_s,
            self._next,
            self._end,
            self._carried,
            self._n_joints,
            held,
            stopped,
            tick_s,
            self.q,
            self.qd,
            self.elapsed_s,
            self.busy_s,
            moved,
        )
        return moved


@njit(cache=True)
def _lay_out(
    t: FloatArray,
    q: FloatArray,
    qd: FloatArray,
    speed: float,
    tick_s: float,
    elapsed_s: float,
    frames: FloatArray,
    frame_s: FloatArray,
) -> int:  # pragma: no cover - compiled
    """Fill in positions and velocities tick by tick, and what is done then; returns how many ticks there are."""
    n = 0
    while n < len(frame_s):
        elapsed_s += tick_s * speed
        if elapsed_s - t[-1] >= 0.0:
            break
        interpolate(t, q, qd, elapsed_s, frames[n])
        for joint in range(q.shape[1]):
            frames[n, 1, joint] *= speed
        frame_s[n] = elapsed_s
        n += 1
    return n


@njit(cache=True)
def _play(  # flat: bundled, it would take longer to hand over than to play
    frames: FloatArray,
    frame_s: FloatArray,
    following: IntArray,
    end: IntArray,
    carried: IntArray,
    n_joints: IntArray,
    held: IntArray,
    stopped: IntArray,
    tick_s: float,
    q: FloatArray,
    qd: FloatArray,
    elapsed_s: FloatArray,
    busy_s: FloatArray,
    moved: BoolArray,
) -> None:  # pragma: no cover - compiled
    for arm in range(len(end)):
        if following[arm] == end[arm] or stopped[arm] > 0:
            continue
        if carried[arm] != NOTHING and held[arm] != carried[arm]:
            end[arm] = following[arm]
            continue
        frame = frames[arm, following[arm]]
        for joint in range(n_joints[arm]):
            q[arm, joint], qd[arm, joint] = frame[0, joint], frame[1, joint]
        elapsed_s[arm] = frame_s[arm, following[arm]]
        busy_s[arm] += tick_s
        following[arm] += 1
        moved[arm] = True
