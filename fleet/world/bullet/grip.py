"""Grip: how a tool holds a parcel, by suction (a breakable constraint) or by friction (two fingers)."""

from __future__ import annotations

import math
from typing import Any, Protocol

import numpy as np

from fleet.arrays import BoolArray, FloatArray
from fleet.config import Grip
from fleet.robots.angle import rotation
from fleet.world.bullet.arms import Arms
from fleet.world.bullet.engine.client import Client
from fleet.world.bullet.parcels import Parcels
from fleet.world.protocol import TOOL_FAILED

_GRAVITY_MPS2 = 9.81

# A cup holds at least 20 N and five times the parcel's weight: enough for every acceleration of the arm.
_LEAST_FORCE_N = 20.0
_WEIGHTS = 5.0
# The constraint itself gives way only far above the limit; the limit is enforced by letting go.
_CONSTRAINT_MARGIN = 10.0
# One step above the limit can be the solver's noise, three cannot.
_OVERLOAD_STEPS = 3
_REACH_M = 0.01
# The cup seals on a face it meets within 18 degrees of square.
_SQUARE = 0.95

_CLOSING_MPS = 0.15
_MIMIC_GAIN = 1.0
# The following finger must not be held up by the parcel it centres.
_MIMIC_FORCE = 4.0


_FIRM_STEPS = 24
"""Substeps both fingers must touch a parcel before it counts as held: 0.1 s for the force to build up."""
_LOST_STEPS = 24
"""Substeps without touch after which a parcel counts as lost."""


class GripDevice(Protocol):
    """The tools of all arms."""

    held: list[int]
    """Parcel in each arm's tool, -1 for none."""
    loss: list[str]
    """Why each arm's tool lost what it held last, in words; empty if it did not."""

    def command(self, grip: BoolArray) -> None:
        """Take what each arm should do in the coming tick: hold (True) or let go."""

    def before_step(self) -> None:
        """Act before a physics step."""

    def after_step(self) -> None:
        """Act after a physics step, when contacts are known."""

    def fail(self, arm: int) -> None:
        """Drop what an arm holds, and hold nothing until it was told to let go."""

    def forget(self, parcel: int) -> None:
        """Let go of a parcel that is about to leave the world."""

    def memory(self) -> Any:
        """What the engine's own snapshot does not hold."""

    def recall(self, memory: Any) -> None:
        """Return to `memory`."""


class SuctionGrip:
    """A cup that sticks to the face of a parcel.

    A fixed constraint is made as soon as the cup should hold and a parcel's face lies within 1 cm of its lip, and
    removed when it should let go, or when pull and shear together exceed the limit: five times the weight, at least
    20 N and at most `most_force_n`. Pressing a parcel down does not break the seal. After a drop the cup stays empty
    until it was off.

    Args:
        client: Connection.
        arms: The arms.
        parcels: The parcels.
        most_force_n: Most force each arm's cup holds [N].
        limit_share: Part of their limits that constraints are given; see `BulletConfig`.
    """

    def __init__(
        self, client: Client, arms: Arms, parcels: Parcels, most_force_n: list[float], *, limit_share: float = 1.0
    ) -> None:
        self._client = client
        self._arms = arms
        self._parcels = parcels
        self._most_force_n = most_force_n
        self._margin = _CONSTRAINT_MARGIN * limit_share
        n = len(arms.bodies)
        self.held = [-1] * n
        self._constraint = [-1] * n
        self._limit = [0.0] * n
        self._overload = [0] * n
        self._dropped = [False] * n
        self.loss = [""] * n
        self._cups = [links.get("cup", -1) for links in arms.links]

    def command(self, grip: BoolArray) -> None:
        """Stick and let go as told."""
        for arm, on in enumerate(grip.tolist()):
            if not on:
                self._dropped[arm] = False
                if self.held[arm] >= 0:
                    self._let_go(arm)
            elif self.held[arm] < 0 and not self._dropped[arm]:
                self._try(arm)

    def before_step(self) -> None:
        """Do nothing: the constraint acts by itself."""

    def after_step(self) -> None:
        """Drop what has become too heavy."""
        for arm, parcel in enumerate(self.held):
            if parcel < 0:
                continue
            felt = self._client.getConstraintState(self._constraint[arm])[:3]
            # Nearly always far below the limit, so the direction of the cup is asked for only when it matters.
            if math.hypot(*felt) > self._limit[arm]:
                force, axis = np.array(felt), rotation(np.array(self._link(arm)[5]))[:, 2]
                pull = float(force @ axis)
                shear = float(np.linalg.norm(force - pull * axis))
                load = float(np.hypot(max(pull, 0.0), shear))
            else:
                load = 0.0
            self._overload[arm] = self._overload[arm] + 1 if load > self._limit[arm] else 0
            if self._overload[arm] >= _OVERLOAD_STEPS:
                self._lose(arm, f"it pulled with {load:.1f} N, the cup holds {self._limit[arm]:.1f} N")

    def fail(self, arm: int) -> None:
        """Break the vacuum."""
        if self.held[arm] >= 0:
            self._lose(arm, TOOL_FAILED)
        self._dropped[arm] = True

    def forget(self, parcel: int) -> None:
        """Let go of a parcel that is about to leave the world."""
        for arm, held in enumerate(self.held):
            if held == parcel:
                self._let_go(arm)

    def memory(self) -> Any:
        """Parcel and constraint of every cup."""
        lists = (self.held, self._constraint, self._limit, self._overload, self._dropped, self.loss)
        return tuple(list(part) for part in lists)

    def recall(self, memory: Any) -> None:
        """Return to `memory`: a constraint that was removed since is made again where the parcel is now."""
        held, constraint, limit, overload, dropped, loss = memory
        for arm, parcel in enumerate(self.held):
            if parcel >= 0 and self._constraint[arm] != constraint[arm]:
                self._let_go(arm)
        for arm, parcel in enumerate(held):
            if parcel >= 0 and self._constraint[arm] != constraint[arm]:
                self._stick(arm, parcel)
        self._limit, self._overload, self._dropped, self.loss = list(limit), list(overload), list(dropped), list(loss)

    def _link(self, arm: int) -> Any:
        return self._client.getLinkState(self._arms.bodies[arm], self._cups[arm], computeForwardKinematics=1)

    def _try(self, arm: int) -> None:
        """Stick to the nearest parcel within reach, if any."""
        state = self._link(arm)
        flange, length_m = state[4], self._arms.tools[arm].length_m
        # Nearly always all parcels are far away, which one looks at first.
        near = []
        for parcel in self._parcels.ids():
            gap_m = math.dist(flange, self._parcels.where(parcel)[:3])
            if gap_m < length_m + math.hypot(*self._parcels.shapes[parcel].size_m) + 2 * _REACH_M:
                near.append(parcel)
        if not near:
            return
        axis = rotation(np.array(state[5]))[:, 2]
        tip = np.array(flange) + axis * length_m
        best, best_gap = -1, _REACH_M
        for parcel in near:
            pose = self._parcels.pose(parcel)
            half = np.array(self._parcels.shapes[parcel].size_m) / 2
            offset = tip - pose[:3]
            if offset @ offset > (half @ half) * 1.5 + _REACH_M:
                continue
            gap = _gap(offset, axis, rotation(pose[3:]), half)
            if gap < best_gap:
                best, best_gap = parcel, gap
        if best >= 0:
            self._stick(arm, best)

    def _stick(self, arm: int, parcel: int) -> None:
        client, body, box = self._client, self._arms.bodies[arm], self._parcels.body(parcel)
        cup, state = self._cups[arm], self._link(arm)
        place, quat = client.getBasePositionAndOrientation(box)
        back = client.invertTransform(state[0], state[1])
        at, turn = client.multiplyTransforms(back[0], back[1], place, quat)
        constraint = client.createConstraint(
            body, cup, box, -1, client.JOINT_FIXED, (0, 0, 0), at, (0, 0, 0), turn, (0, 0, 0, 1)
        )
        weight = self._parcels.shapes[parcel].mass_kg * _GRAVITY_MPS2
        self._limit[arm] = min(self._most_force_n[arm], max(_LEAST_FORCE_N, _WEIGHTS * weight))
        client.changeConstraint(constraint, maxForce=self._margin * self._limit[arm])
        client.setCollisionFilterPair(body, box, cup, -1, 0)
        self.held[arm], self._constraint[arm], self._overload[arm] = parcel, constraint, 0
        self.loss[arm] = ""

    def _lose(self, arm: int, cause: str) -> None:
        self._let_go(arm)
        self._dropped[arm], self.loss[arm] = True, cause

    def _let_go(self, arm: int) -> None:
        self._client.removeConstraint(self._constraint[arm])
        box = self._parcels.body(self.held[arm])
        self._client.setCollisionFilterPair(self._arms.bodies[arm], box, self._cups[arm], -1, 1)
        self.held[arm], self._constraint[arm] = -1, -1


def _gap(offset: FloatArray, axis: FloatArray, turn: FloatArray, half: FloatArray) -> float:
    """Distance from the cup's lip to the face it looks at [m], infinite if it looks past the box or at an edge."""
    local, look = turn.T @ offset, turn.T @ axis
    face = int(np.abs(look).argmax())
    others = [k for k in range(3) if k != face]
    if abs(look[face]) < _SQUARE or any(abs(local[k]) > half[k] for k in others):
        return np.inf
    return abs(-np.sign(look[face]) * local[face] - half[face])


class FrictionGrip:
    """Two fingers that close with limited force; a parcel is held while both touch it.

    The pads' friction is anchored: where a pad has touched a parcel, a spring holds it. The second finger follows the
    first one's measured position, which keeps the parcel centred: two independent fingers push it to one side and lose
    it.

    Args:
        client: Connection.
        arms: The arms.
        parcels: The parcels.
        force_n: Force limit of each arm's leading finger [N].
        touched: Parcels that each arm's links touch: ``touched[arm][link]`` is a set of parcel ids, kept by the caller.
    """

    def __init__(
        self, client: Client, arms: Arms, parcels: Parcels, force_n: list[float], touched: list[dict[int, set[int]]]
    ) -> None:
        self._client = client
        self._arms = arms
        self._parcels = parcels
        self._force_n = force_n
        self._touched = touched
        self._fingers = [
            [links[name] for name in tool.touch_links] for links, tool in zip(arms.links, arms.tools, strict=True)
        ]
        n = len(arms.bodies)
        self.held = [-1] * n
        self._closed: list[bool | None] = [None] * n
        self._steady = [0] * n
        self._failed = [False] * n
        self.loss = [""] * n
        for body, tool, fingers in zip(arms.bodies, arms.tools, self._fingers, strict=True):
            for finger in fingers:
                client.resetJointState(body, finger, tool.finger_travel_m)
                # Friction alone only stops velocities, step by step, and lets a parcel creep out at 4 mm/s; an anchor
                # also takes back the way.
                client.changeDynamics(body, finger, frictionAnchor=1)

    def command(self, grip: BoolArray) -> None:
        """Open and close as told."""
        for arm, told in enumerate(grip.tolist()):
            self._failed[arm] &= told
            on = told and not self._failed[arm]
            if on == self._closed[arm]:
                continue
            self._closed[arm] = on
            if not on and self.held[arm] >= 0:
                self._renew_contacts(arm, self.held[arm])
            target = 0.0 if on else self._arms.tools[arm].finger_travel_m
            for finger in self._fingers[arm]:
                self._move(arm, finger, target)

    def before_step(self) -> None:
        """Let the second finger of each closed hand follow the first."""
        for arm, closed in enumerate(self._closed):
            if closed:
                lead, follow = self._fingers[arm]
                body = self._arms.bodies[arm]
                self._client.setJointMotorControl2(
                    body,
                    follow,
                    self._client.POSITION_CONTROL,
                    self._client.getJointState(body, lead)[0],
                    force=_MIMIC_FORCE * self._force_n[arm],
                    positionGain=_MIMIC_GAIN,
                )

    def after_step(self) -> None:
        """See what is between the fingers."""
        for arm, links in enumerate(self._touched):
            left, right = (links.get(finger, set()) for finger in self._fingers[arm])
            both = left & right if self._closed[arm] else set()
            if self.held[arm] in both:
                self._steady[arm] = _LOST_STEPS
            elif self.held[arm] >= 0 and self._closed[arm]:
                # A rigid finger rattles: one substep without contact is not yet a lost parcel.
                self._steady[arm] -= 1
                if self._steady[arm] == 0:
                    self.held[arm] = -1
                    self.loss[arm] = f"it slipped from the fingers, which press with {self._force_n[arm]:g} N"
            else:
                self._steady[arm] = self._steady[arm] + 1 if both else 0
                self.held[arm] = min(both) if self._steady[arm] >= _FIRM_STEPS else -1
                if self.held[arm] >= 0:
                    self.loss[arm] = ""

    def fail(self, arm: int) -> None:
        """Open the fingers, from the next tick on."""
        if self.held[arm] >= 0:
            self.loss[arm] = TOOL_FAILED
        self._failed[arm] = True

    def forget(self, parcel: int) -> None:
        """Let go of a parcel that is about to leave the world."""
        self.held = [-1 if held == parcel else held for held in self.held]

    def memory(self) -> Any:
        """Parcel of every hand, and for how long it has been or can do without touch."""
        return list(self.held), list(self._steady), list(self._failed), list(self.loss)

    def recall(self, memory: Any) -> None:
        """Return to `memory`."""
        self.held, self._steady, self._failed, self.loss = (list(part) for part in memory)
        self._closed = [None] * len(self.held)  # the next command sets every finger anew

    def _renew_contacts(self, arm: int, parcel: int) -> None:
        """Let the engine forget where the pads touch a parcel, and find it out anew in the next substep.

        Contacts that are kept while a parcel is held turn with its edges; some end up with a normal that points back at
        the pad, and then hold an opening finger to the parcel.
        """
        body, box = self._arms.bodies[arm], self._parcels.body(parcel)
        for finger in self._fingers[arm]:
            self._client.setCollisionFilterPair(body, box, finger, -1, 0)
            self._client.setCollisionFilterPair(body, box, finger, -1, 1)

    def _move(self, arm: int, finger: int, target: float) -> None:
        self._client.setJointMotorControl2(
            self._arms.bodies[arm],
            finger,
            self._client.POSITION_CONTROL,
            target,
            force=self._force_n[arm],
            maxVelocity=_CLOSING_MPS,
        )


def make_grip(
    kind: Grip,
    client: Client,
    arms: Arms,
    parcels: Parcels,
    *,
    force_n: float | None,
    touched: list[dict[int, set[int]]],
    limit_share: float = 1.0,
) -> GripDevice:
    """Make the grip of a kind, with the tools' own forces where none is given; see `SuctionGrip` and `FrictionGrip`."""
    force_of_arm = [force_n or tool.force_n for tool in arms.tools]
    if kind is Grip.FRICTION:
        return FrictionGrip(client, arms, parcels, force_of_arm, touched)
    return SuctionGrip(client, arms, parcels, force_of_arm, limit_share=limit_share)
