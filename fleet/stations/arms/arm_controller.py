"""ArmController: plays a planned transfer on one arm, tick by tick, and watches its grip."""

from __future__ import annotations

from collections.abc import Iterator
from enum import StrEnum
from typing import Protocol

from fleet.stations.arms.playing.playback import NOTHING, Playback
from fleet.stations.arms.transfer import Signal, Step, Transfer
from planners.motion.path.trajectory import Trajectory

GRIP_TIMEOUT_S = 0.6
"""A grip that does not hold after this long has missed; suction needs 1 tick, fingers 0.4 s."""
SETTLE_S = 0.15
"""Rest after a grip or release, for the parcel to come to rest."""


class ArmPhase(StrEnum):
    """What an arm is doing."""

    IDLE = "idle"
    PLANNING = "planning"
    MOVING = "moving"
    HOLDING = "holding"
    """A parcel is in the grip, fetched ahead; the arm waits above its slot."""
    DONE = "done"
    """The transfer is complete; the arm is home."""
    MISSED = "missed"
    """The grip closed on nothing; the arm stands above the target."""
    DROPPED = "dropped"
    """A held parcel was lost."""


# Members of an enumeration are slow to look up, and every arm is asked in every tick.
_MOVING = ArmPhase.MOVING
_CLEAR, _GRIP, _RELEASE = Signal.CLEAR, Signal.GRIP, Signal.RELEASE
_BUSY, _MAY_CARRY = (ArmPhase.PLANNING, ArmPhase.MOVING), (ArmPhase.MOVING, ArmPhase.HOLDING)


class Gate(Protocol):
    """Who has a say in when an arm moves."""

    def may_start(self, motion: Trajectory) -> bool:
        """Whether a motion may begin now; asked again at the next tick if not."""

    def may_go_on(self) -> bool:
        """Whether a motion that was stopped may go on."""

    @property
    def other(self) -> int:
        """The arm that this one waits for when it may not move."""

    def look_again(self) -> None:
        """The arm is at another pace than it was said to be."""


class ArmController:
    """One arm's transfer in progress.

    Args:
        arm: Index of the arm in the world.
        playback: Has the joints of all arms, and plays what needs no decision.
    """

    fetches = True
    """Whether it can take a parcel before the car is there."""

    def __init__(self, arm: int, playback: Playback) -> None:
        self.arm = arm
        self.state = ArmPhase.IDLE
        self._playback = playback
        self.q, self.qd = playback.joints(arm)
        self.grip = False
        self.speed = 1.0
        """Playback speed, below 1 when the arm is slow; see `set_speed`."""
        self.gate: Gate | None = None
        """Asked before every motion; None = always free to move."""
        self.paused = False
        """Whether the gate has stopped a motion."""
        self._steps: tuple[Step, ...] = ()
        self._back: tuple[Step, ...] = ()
        self._at = 0
        self._clear_at = 0
        """Number of the step from which on the dock is clear."""
        self._carrying = False
        self._lost = False
        self._denied = False
        """Whether the gate has not let the next motion begin."""
        self.parcel = -1
        self.grip_height_m = 0.0
        """The tip's height over the underside of a parcel that was fetched [m]."""

    @property
    def done_s(self) -> float:
        """How much of the present step is done [s]."""
        return float(self._playback.elapsed_s[self.arm])

    @property
    def carries(self) -> bool:
        """Whether a parcel is in the grip."""
        return self._carrying

    @property
    def under_way(self) -> Trajectory | None:
        """The motion that has begun and is not over."""
        if self.state is not ArmPhase.MOVING or self.done_s == 0.0:
            return None
        step = self._steps[self._at]
        return step if isinstance(step, Trajectory) else None

    @property
    def at(self) -> tuple[int, int]:
        """Index of the present step, and how many there are."""
        return self._at, len(self._steps)

    @property
    def ahead(self) -> Iterator[tuple[Trajectory, float]]:
        """Motions up to the next grip or release, and how long each has gone on; negative: how long until it begins."""
        if self.state is not ArmPhase.MOVING:
            return
        done_s = self.done_s
        for step in self._steps[self._at :]:
            if isinstance(step, Trajectory):
                yield step, done_s
                done_s -= step.duration_s
            elif step is not Signal.CLEAR:
                return

    @property
    def waits_for(self) -> int:
        """The arm whose motions keep this one from moving, -1 = none."""
        if self.gate is None or self.state is not ArmPhase.MOVING:
            return -1
        return self.gate.other if self.paused or self._denied else -1

    def set_speed(self, speed: float) -> None:
        """Play motions at another speed from now on."""
        self.speed = speed
        self._playback.change(self.arm)

    def left_s(self) -> tuple[float, float]:
        """Time until the dock is clear, and until the transfer is over, at the present speed if nothing stops it."""
        if self.state is not ArmPhase.MOVING:
            return 0.0, 0.0
        clear_s = left_s = -self.done_s
        cleared = self.dock_is_clear
        for step in self._steps[self._at :]:
            if step is Signal.CLEAR and not cleared:
                clear_s, cleared = left_s, True
            elif step is not Signal.CLEAR:
                left_s += step.duration_s if isinstance(step, Trajectory) else SETTLE_S
        return max(0.0, clear_s if cleared else left_s) / self.speed, max(0.0, left_s) / self.speed

    @property
    def dock_is_clear(self) -> bool:
        """True when the arm no longer needs the car to stand still."""
        if self.state in _BUSY:
            return self.state is _MOVING and self._clear_at <= self._at
        return True

    def request(self) -> None:
        """Note that a plan was asked for."""
        self._playback.change(self.arm)
        self.state = ArmPhase.PLANNING

    def play(self, transfer: Transfer) -> None:
        """Start a planned transfer."""
        self.parcel, self.grip_height_m = transfer.parcel, transfer.grip_height_m
        self._back = transfer.back
        self._begin(transfer.steps)

    def put_back(self) -> None:
        """Put a fetched parcel back on its slot and come home."""
        steps, self._back = self._back, ()
        self._begin(steps)

    def reset(self) -> None:
        """Leave a final state and be ready for the next transfer."""
        self._playback.change(self.arm)
        self.state = ArmPhase.IDLE
        self._steps, self._at = (), 0

    def refused(self) -> None:
        """There is no plan: be ready for another transfer, when what was fetched is put back."""
        if self._back:
            self.put_back()
        else:
            self.reset()

    def release(self) -> None:
        """Let go of whatever the arm holds."""
        self.grip = False

    def tick(self, tick_s: float, held: int) -> None:
        """Advance by one tick that is not laid out.

        Args:
            tick_s: Length of the tick [s].
            held: Parcel in the arm's grip now, -1 for none.
        """
        self.qd[:] = 0.0
        if self.state in _BUSY:
            self._playback.busy_s[self.arm] += tick_s
        if self._carrying and held != self.parcel and self.state in _MAY_CARRY:
            if self.gate is None or self.under_way is None:
                self._end(ArmPhase.DROPPED)
                return
            # Another arm counts on this motion: it is ended first.
            self._lost = True
        if self.state is not _MOVING or not self._may_move():
            return
        left_s = tick_s * self.speed
        while left_s > 0.0 and self.state is _MOVING:
            left_s = self._advance(self._steps[self._at], left_s, held)
        motion = self.under_way
        if motion is not None and self.gate is None:
            # With a gate it may be stopped at any time.
            carried = self.parcel if self._carrying else NOTHING
            self._playback.lay_out(self.arm, motion, self.speed, tick_s, carried)

    def _advance(self, step: Step, left_s: float, held: int) -> float:
        """Spend up to `left_s` on a step; returns what is left."""
        if step is _CLEAR:
            self._next()
            return left_s
        done_s = self.done_s
        if isinstance(step, Trajectory):
            if done_s == 0.0 and self.gate is not None:
                self._denied = not self.gate.may_start(step)
                if self._denied:
                    return 0.0
            done_s += left_s
            self._playback.elapsed_s[self.arm] = done_s
            over_s = done_s - step.duration_s
            self.q[:], qd = step.sample(min(done_s, step.duration_s))
            self.qd[:] = qd * self.speed
            if over_s < 0.0:
                return 0.0
            if self._lost:
                self._end(ArmPhase.DROPPED)
                return 0.0
            self._next()
            return over_s
        # A grip or release is a command to the world: it takes effect with this tick, so the rest of the tick is spent.
        self.grip = step is _GRIP
        done_s += left_s
        self._playback.elapsed_s[self.arm] = done_s
        if self.grip and held == self.parcel and done_s >= SETTLE_S:
            self._carrying = True
            self._next()
        elif self.grip and done_s >= GRIP_TIMEOUT_S:
            self.grip = False
            self._end(ArmPhase.MISSED)
        elif step is _RELEASE:
            self._carrying = False
            if done_s >= SETTLE_S and held != self.parcel:
                self._next()
        return 0.0

    def _next(self) -> None:
        self._playback.change(self.arm)
        self._at += 1
        self._playback.elapsed_s[self.arm] = 0.0
        if self._at < len(self._steps):
            return
        if self._back:
            self.state = ArmPhase.HOLDING
        else:
            self._end(ArmPhase.DONE)

    def _begin(self, steps: tuple[Step, ...]) -> None:
        self._playback.change(self.arm)
        self.state = ArmPhase.MOVING
        self._steps, self._at = steps, 0
        self._clear_at = steps.index(_CLEAR) if _CLEAR in steps else len(steps)
        self._playback.elapsed_s[self.arm] = 0.0

    def _may_move(self) -> bool:
        if self.paused and self.gate is not None:
            self.paused = not self.gate.may_go_on()
        return not self.paused

    def _end(self, state: ArmPhase) -> None:
        self._playback.change(self.arm)
        self.state = state
        self._carrying = self._lost = self._denied = self.paused = False
        self._back = ()
