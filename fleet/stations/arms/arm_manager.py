"""ArmManager: all arms of a site: asks for their plans, plays them when they are due, brings a failed arm home."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Protocol

import numpy as np

from fleet.arrays import FloatArray, IntArray
from fleet.config import ArmConfig
from fleet.stations.arms.arm_controller import ArmController, ArmPhase
from fleet.stations.arms.playing.playback import Playback
from fleet.stations.arms.transfer import (
    ArmRequest,
    DeliverRequest,
    FetchRequest,
    HomeRequest,
    Transfer,
    TransferRequest,
)
from fleet.world.scene import Scene

# Members of an enumeration are slow to look up, and every arm is asked in every tick.
_IDLE, _HOLDING, _DONE, _DROPPED = ArmPhase.IDLE, ArmPhase.HOLDING, ArmPhase.DONE, ArmPhase.DROPPED
_FAILED = (ArmPhase.MISSED, ArmPhase.DROPPED)
LOOK_AGAIN_S = 1.0
"""Time from a look that did not find a parcel to the next: what hid it may have moved [s]."""


class ArmPlanner(Protocol):
    """Answers requests in the order they were made; the answer depends on the request alone."""

    def wait_ready(self) -> None:
        """Wait until it can answer; raises UnreachableError if an arm cannot serve its station."""

    def close(self) -> None:
        """Free what it holds; calling twice is harmless."""

    def keep_trees(self) -> None:
        """Put search trees into the answers to all requests from now on."""

    def submit(self, request: ArmRequest) -> int:
        """Hand in a request; returns its ticket."""

    def result(self, ticket: int) -> Transfer:
        """The answer to a ticket; waits for it."""


class ArmManager:
    """Requests and services of all arms.

    Args:
        planner: Answers requests.
        config: Latency of an answer in simulated time.
        scene: The arms where they start, and the model of the cars that are served.
        tick_s: Length of a tick [s].
        lost: Called as ``lost(arm, parcel)`` when an arm has lost a parcel from its grip; returns why, in words, or
            nothing if it was taken away on purpose.
    """

    def __init__(
        self,
        planner: ArmPlanner,
        config: ArmConfig,
        scene: Scene,
        tick_s: float,
        *,
        lost: Callable[[int, int], str] = lambda arm, parcel: "",
    ) -> None:
        start_rad = np.asarray(scene.arm_start, dtype=np.float64)
        self.car = scene.cars.hull
        self._playback = Playback(start_rad, scene.arms.n_joints.tolist())
        self.q = self._playback.q
        """Set-points of all joints [rad], shape (n_arms, n_joints)."""
        self.qd = self._playback.qd
        self.services = [self._service(arm, self._playback) for arm in range(len(start_rad))]
        self.grip = np.zeros(len(start_rad), dtype=np.bool_)
        self._planner = planner
        self._lost = lost
        self.n_dropped = 0
        """Parcels that arms have lost from their grips."""
        self._latency = round(config.latency_s / tick_s)
        self._tick_s = tick_s
        self._due: dict[int, tuple[int, int | Transfer]] = {}
        self._reasons = [""] * len(start_rad)
        self.dead = np.zeros(len(start_rad), dtype=np.bool_)
        """Arms that stand still because they are dead, shape (n_arms,); whoever says so stops them."""
        self._n_stops = np.zeros(len(start_rad), dtype=np.int64)
        self._outside: set[int] = set()
        self._fetched_for = np.zeros(len(start_rad), dtype=np.int64)
        """For which kind of tray each arm has fetched what it holds ahead."""
        self.trees: dict[int, FloatArray] = {}
        """Search trees behind the plans that have landed, by arm, as in `Transfer`; whoever shows them takes them."""

    def keep_trees(self) -> None:
        """Fill `trees` from now on."""
        self._planner.keep_trees()

    def is_idle(self, arm: int) -> bool:
        """True when an arm is home, has nothing to do, and is not in other hands."""
        return self.rests(arm) and arm not in self._outside

    def rests(self, arm: int) -> bool:
        """True when an arm has nothing to do for the fleet, wherever it is."""
        return self.services[arm].state is _IDLE

    def hand_over(self, arm: int) -> None:
        """Let somebody else write the rows of an idle arm in `q` and `qd`, until `take_back`."""
        self._outside.add(arm)

    def come_home(self, arm: int, tick: int) -> None:
        """Let an arm that was handed over find its way home, if there is one; it `rests` afterwards."""
        self._ask(arm, self._planner.submit(HomeRequest(arm=arm, q=self.q[arm].copy())), tick)

    def take_back(self, arm: int) -> None:
        """End a `hand_over`: the arm is home."""
        self._outside.discard(arm)

    def is_ready(self, arm: int, parcel: int, tray: int = 0) -> bool:
        """True when an arm could begin to serve a car with a parcel: it is home, or holds just that parcel for it.

        Args:
            arm: The arm.
            parcel: The parcel.
            tray: Which kind of tray the car has.
        """
        service = self.services[arm]
        holds = service.state is _HOLDING and service.parcel == parcel
        return self.is_idle(arm) or (holds and self.fetched_for(arm) == tray)

    def fetched_for(self, arm: int) -> int:
        """For which kind of tray an arm has fetched what it holds ahead."""
        return int(self._fetched_for[arm])

    def fetch(self, request: FetchRequest, tick: int) -> None:
        """Ask for a parcel to be fetched ahead, by an arm that is idle."""
        self._reasons[request.arm] = ""
        self._fetched_for[request.arm] = request.tray
        self._ask(request.arm, self._planner.submit(request), tick)

    def put_back(self, arm: int) -> None:
        """Let an arm put back what it has fetched."""
        self.services[arm].put_back()

    def due_tick(self, arm: int) -> int | None:
        """Tick at which the plan that was asked for an arm lands; None = none was."""
        return self._due[arm][0] if arm in self._due else None

    def reason(self, arm: int) -> str:
        """Why the arm's last transfer failed; empty when it did not."""
        return self._reasons[arm]

    def submit(self, request: TransferRequest, tick: int) -> None:
        """Ask for a transfer; it starts when the latency has passed. What an arm holds already is delivered."""
        self._reasons[request.arm] = ""
        service = self.services[request.arm]
        question: ArmRequest = request
        if service.state is _HOLDING:
            question = DeliverRequest(
                arm=request.arm,
                parcel=request.parcel,
                size_m=request.size_m,
                pick_via=request.pick_via,
                place_via=request.place_via,
                car_pose=request.car_pose,
                grip_height_m=service.grip_height_m,
                tray=request.tray,
                tray_at_m=request.tray_at_m,
            )
        self._ask(request.arm, self._planner.submit(question), tick)

    def refuse(self, arm: int, parcel: int, reason: str, tick: int) -> None:
        """Answer a transfer for which no request can be made, as its parcel was not found, after `LOOK_AGAIN_S`."""
        self._reasons[arm] = ""
        self.services[arm].request()
        refusal = Transfer(arm=arm, parcel=parcel, steps=(), reason=reason)
        self._due[arm] = (tick + round(LOOK_AGAIN_S / self._tick_s), refusal)

    def slow(self, arm: int, factor: float) -> None:
        """Play an arm's motions at a fraction of their speed."""
        self.services[arm].set_speed(factor)
        gate = self.services[arm].gate
        if gate is not None:
            gate.look_again()

    def stop(self, arms: Iterable[int]) -> None:
        """Let arms stand still where they are, until as many calls of `go_on`."""
        for arm in arms:
            self._n_stops[arm] += 1
            self._playback.n_changes[arm] += 1

    def go_on(self, arms: Iterable[int]) -> None:
        """End a `stop`."""
        for arm in arms:
            self._n_stops[arm] -= 1
            self._playback.n_changes[arm] += 1

    def tick(self, tick: int, held: IntArray) -> None:
        """Land the answers that are due and advance every busy arm; fills `q`, `qd` and `grip`."""
        for arm, (due_tick, answer) in list(self._due.items()):
            if due_tick <= tick:
                del self._due[arm]
                self._land(arm, answer if isinstance(answer, Transfer) else self._planner.result(answer))
        moved = self._playback.tick(self._tick_s, held, self._n_stops).tolist()
        for service in self.services:
            if service.state is _IDLE or moved[service.arm]:
                continue
            if self._n_stops[service.arm]:
                self.qd[service.arm] = 0.0
                continue
            service.tick(self._tick_s, int(held[service.arm]))
            self.grip[service.arm] = service.grip
            if service.state is _DONE:
                service.reset()
            elif service.state in _FAILED:
                self._reasons[service.arm] = f"arm_{service.arm} {service.state} the parcel"
                cause = self._lost(service.arm, service.parcel) if service.state is _DROPPED else ""
                if cause:
                    self.n_dropped += 1
                    self._reasons[service.arm] += f" ({cause})"
                service.release()
                self._ask(service.arm, self._planner.submit(HomeRequest(arm=service.arm, q=service.q.copy())), tick)

    def is_stopped(self, arm: int) -> bool:
        """Whether an arm has to stand still."""
        return bool(self._n_stops[arm] > 0)

    @property
    def n_changes(self) -> IntArray:
        """How often the state, step or speed of each arm has changed, or it was stopped or let go, shape (n_arms,)."""
        return self._playback.n_changes

    def busy_s(self) -> FloatArray:
        """Time each arm has worked so far [s], shape (n_arms,)."""
        return self._playback.busy_s.copy()

    def _service(self, arm: int, playback: Playback) -> ArmController:
        return ArmController(arm, playback)

    def _ask(self, arm: int, ticket: int, tick: int) -> None:
        self.services[arm].request()
        self._due[arm] = (tick + self._latency, ticket)

    def _land(self, arm: int, transfer: Transfer) -> None:
        if transfer.trees is not None:
            self.trees[arm] = transfer.trees
        if transfer.reason:
            self._reasons[arm] = transfer.reason
            self.services[arm].refused()
        else:
            self.services[arm].play(transfer)
