"""Playback: what is laid out is what the arm would have done when asked tick by tick."""

from __future__ import annotations

import numpy as np
import pytest

from fleet.arrays import FloatArray, IntArray
from fleet.robots import ARMS
from fleet.stations.arms.arm_controller import ArmController, ArmPhase
from fleet.stations.arms.playing.playback import Playback
from fleet.stations.arms.transfer import Signal, Transfer
from planners.motion.path.trajectory import Trajectory, retime

TICK_S, PARCEL = 0.05, 4
ARM = ARMS["iiwa"].spec()


def way(first: float, last: float) -> Trajectory:
    """A motion of all joints."""
    path = np.array([np.full(7, first), np.full(7, last)])
    return retime(path, ARM.max_velocity_radps, ARM.max_acceleration_radps2, dt_s=0.01)


class Arm:
    """One arm, moved as its manager moves it."""

    def __init__(self, *steps: Trajectory | Signal) -> None:
        self.playback = Playback(np.zeros((1, 7)), [7])
        self.controller = ArmController(0, self.playback)
        self.controller.play(Transfer(arm=0, parcel=PARCEL, steps=steps))
        self.n_asked = 0

    def tick(self, held: int = -1, stopped: int = 0) -> FloatArray:
        """Where the arm is after one tick more."""
        numbers: list[IntArray] = [np.array([held]), np.array([stopped])]
        if not self.playback.tick(TICK_S, *numbers)[0] and not stopped:
            self.n_asked += 1
            self.controller.tick(TICK_S, held)
        return self.playback.q[0].copy()


@pytest.mark.parametrize("speed", [1.0, 0.3])
def test_a_motion_is_played_as_it_was_planned(speed: float) -> None:
    motion = way(0.0, 1.5)
    arm = Arm(motion, way(1.5, 0.0))
    arm.controller.set_speed(speed)
    done_s = 0.0
    while done_s + TICK_S * speed < motion.duration_s:
        done_s += TICK_S * speed
        q = arm.tick()
        np.testing.assert_array_equal(q, motion.sample(done_s)[0])
        np.testing.assert_array_equal(arm.playback.qd[0], motion.sample(done_s)[1] * speed)
        assert arm.controller.done_s == done_s
    n_ticks = round(done_s / (TICK_S * speed))
    assert arm.playback.busy_s[0] == pytest.approx(n_ticks * TICK_S)
    assert arm.n_asked <= 1 + n_ticks // 64
    arm.tick()
    assert arm.controller.at == (1, 2)


def test_another_speed_counts_from_the_next_tick_on() -> None:
    motion = way(0.0, 1.5)
    arm = Arm(motion)
    arm.tick()
    arm.controller.set_speed(0.5)
    np.testing.assert_array_equal(arm.tick(), motion.sample(TICK_S + 0.5 * TICK_S)[0])


def test_an_arm_that_is_stopped_goes_on_where_it_stood() -> None:
    motion = way(0.0, 1.5)
    arm = Arm(motion)
    before = arm.tick()
    np.testing.assert_array_equal(arm.tick(stopped=1), before)
    np.testing.assert_array_equal(arm.tick(), motion.sample(2 * TICK_S)[0])


def test_a_parcel_that_is_lost_on_the_way_ends_the_motion() -> None:
    arm = Arm(Signal.GRIP, way(0.0, 1.5))
    while arm.controller.at[0] == 0:
        arm.tick(PARCEL)
    for _ in range(3):
        arm.tick(PARCEL)
    assert arm.controller.state is ArmPhase.MOVING
    arm.tick(-1)
    assert arm.controller.state is ArmPhase.DROPPED
