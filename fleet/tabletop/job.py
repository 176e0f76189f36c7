"""Job: the loop that sorts a table: look, plan, agree on who waits for whom, move; until nothing is left to do."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

import numpy as np

from fleet.arrays import FloatArray
from fleet.stations.arms.arm_spheres import PlannedArm
from fleet.tabletop.arm import NOBODY, Chore, TableArm
from fleet.tabletop.layout import Layout
from fleet.world.bullet.bench.table import TICK_S, TableWorld
from planners.motion.collision.obstacles import Capsules
from planners.motion.path.timed_path import TimedPath, timed_path
from planners.motion.path.trajectory import Trajectory
from planners.motion.two_arms.schedule import Schedule, schedule

STEP_S = 0.02
"""Step of the schedule of two arms."""
_SETTLE_S = 0.6
_CONFIRM_S = 0.05
"""Moments of a schedule that the physics engine is shown are so far apart."""
_N_TRIES = 3
"""Times that a thing is tried before it is given up."""
_N_CHOICES = 3
"""Things among which an arm chooses one that goes together with the other arm's."""
_SPARE_ROUNDS = 2
_DROP_GAP_M = 0.004
"""A thing is let go so far above the table."""


@dataclass(kw_only=True)
class Tally:
    """What came of a job."""

    n_sorted: int = 0
    n_objects: int = 0
    n_rounds: int = 0
    n_together: int = 0
    """Rounds in which two arms worked at the same time."""
    n_missed: int = 0
    """Times that a tool did not get hold of a thing, or lost it."""
    n_refused: int = 0
    """Paths that the physics engine did not let pass."""
    robot_contacts: int = 0
    """Ticks in which arms touched each other."""
    sim_s: float = 0.0
    reasons: dict[int, str] = field(default_factory=dict)
    """Why each thing that is not sorted is where it is."""

    @property
    def done(self) -> bool:
        """Whether everything is sorted."""
        return self.n_sorted == self.n_objects


@dataclass(frozen=True, kw_only=True, eq=False)
class _Part:
    """What one arm does in a round."""

    path: TimedPath
    chore: Chore | None


class Job:
    """Sorts one table.

    Args:
        layout: What belongs where.
        model: The arms.
        world: The engine, with the layout's scene.
        seed: Seed of the searches.
        watch: Called after every tick.
    """

    def __init__(
        self,
        layout: Layout,
        model: PlannedArm,
        world: TableWorld,
        *,
        seed: int = 0,
        watch: Callable[[], None] = lambda: None,
    ) -> None:
        self._layout, self._world, self._seed, self._watch = layout, world, seed, watch
        self._arms = [TableArm(model, base, layout.scene.boxes) for base in layout.scene.arm_base]
        if len(self._arms) > 1:
            self._arms[0].meet(self._arms[1])
        self._q = np.array([arm.home for arm in self._arms])
        self._grip = np.zeros(len(self._arms), dtype=np.bool_)
        self._tries: Counter[int] = Counter()
        self.tally = Tally(n_objects=len(layout.scene.objects))

    def close(self) -> None:
        """Free what paths are confirmed with; calling twice is harmless."""
        for arm in self._arms:
            arm.close()

    def run(self) -> Tally:
        """Work until everything is sorted, or nothing that is left can be brought."""
        self._rest(_SETTLE_S)
        most = _N_TRIES * len(self._layout.scene.objects) + _SPARE_ROUNDS
        while self.tally.n_rounds < most:
            parts = self._round()
            if not any(part is not None and part.chore is not None for part in parts):
                break
            self.tally.n_rounds += 1
        self._all_home()
        self._rest(_SETTLE_S)
        self._count()
        return self.tally

    def _round(self) -> list[_Part | None]:
        """Plan and play one chore of each arm that has one; arms that have none go home."""
        corners = [self._world.object_corners(k) for k in range(self.tally.n_objects)]
        seed = self._seed + 100 * self.tally.n_rounds
        options = [self._chores(number, corners, seed) for number in range(len(self._arms))]
        if len(self._arms) == 1:
            parts: list[_Part | None] = [options[0][0] if options[0] else None]
            found = None
        else:
            parts, found = self._agree(options, corners, seed)
        self._play(parts, found)
        return parts

    def _chores(self, number: int, corners: list[FloatArray], seed: int) -> list[_Part]:
        """Things that an arm could bring now, nearest first."""
        arm, layout = self._arms[number], self._layout
        # The other arm may always go home first, whatever it does meanwhile.
        beside = self._beside(number)
        poses = self._world.object_poses()
        mine = [k for k, other in enumerate(layout.arm_of) if other == number and self._open(k, poses)]
        feet = layout.scene.arm_base[number, :2]
        # Of things that lie on each other, the upper one goes first.
        mine.sort(key=lambda k: (-round(float(corners[k][:, 2].max()), 2), float(np.linalg.norm(poses[k, :2] - feet))))
        wanted = 1 if len(self._arms) == 1 else _N_CHOICES
        chores: list[_Part] = []
        for k in mine:
            spot = self._spot(layout.place_of[k], corners)
            chore = arm.bring(self._q[number], k, poses[k], corners, spot, seed + k, beside)
            if isinstance(chore, str):
                self.tally.reasons[k] = chore
                self._tries[k] += 1
                continue
            chores.append(_Part(path=timed_path(chore.segments, STEP_S), chore=chore))
            if len(chores) == wanted:
                break
        return chores

    def _open(self, thing: int, poses: FloatArray) -> bool:
        """Whether a thing is still to be brought, and worth another try."""
        place = self._layout.places[self._layout.place_of[thing]]
        return not place.holds(poses[thing, :3]) and self._tries[thing] < _N_TRIES

    def _spot(self, place: int, corners: list[FloatArray]) -> FloatArray:
        """The slot of a place that is farthest from everything that lies there: x, y, height of the underside."""
        slots = self._layout.places[place].slots
        middles = np.array([(own.min(axis=0) + own.max(axis=0)) / 2 for own in corners])[:, :2]
        room = np.linalg.norm(slots[:, None] - middles, axis=2).min(axis=1)
        # Nearly equal room is equal: the first slot is taken.
        best = int(np.argmax(np.minimum(np.round(room, 2), 0.07)))
        return np.array([*slots[best], _DROP_GAP_M + self._layout.drop_m])

    def _agree(
        self, options: list[list[_Part]], corners: list[FloatArray], seed: int
    ) -> tuple[list[_Part | None], Schedule | None]:
        """A schedule for two arms: both work, or one works while the other goes home."""
        for first, second in self._pairs(options, corners, seed):
            found = self._scheduled(first, second)
            if found.solved and self._confirmed(first, second, found):
                self.tally.n_together += first.chore is not None and second.chore is not None
                return [first, second], found
        for part in [part for own in options for part in own]:
            if part.chore is not None:
                self.tally.reasons[part.chore.thing] = "no schedule with the other arm"
        return [None, None], None

    def _pairs(self, options: list[list[_Part]], corners: list[FloatArray], seed: int) -> Iterator[tuple[_Part, _Part]]:
        """What two arms could do in one round, best first; ways home are planned only if it comes to that."""
        yield from ((a, b) for a in options[0] for b in options[1])
        for worker in range(2):
            # The worker waits where it rests until the other is home, if it has to.
            home = self._way_home(1 - worker, corners, seed, self._q[worker]) if options[worker] else None
            if home is not None:
                yield from ((part, home) if worker == 0 else (home, part) for part in options[worker])

    def _scheduled(self, first: _Part, second: _Part) -> Schedule:
        held = [None if part.chore is None else part.chore.reach_m for part in (first, second)]
        arms = [arm.in_world(reach) for arm, reach in zip(self._arms, held, strict=True)]
        return schedule(arms, [first.path, second.path])

    def _confirmed(self, first: _Part, second: _Part, found: Schedule) -> bool:
        """Whether the engine lets two motions pass as they are scheduled."""
        times = np.append(np.arange(0.0, found.makespan_s, _CONFIRM_S), found.makespan_s)
        own, theirs = (
            np.array([part.path.at(found.along_s(number, float(t))) for t in times])
            for number, part in enumerate((first, second))
        )
        return not self._arms[0].touches(own, theirs)

    def _beside(self, number: int, other_q: FloatArray | None = None) -> Capsules:
        """The other arm as this one sees it at rest: at home, unless told otherwise."""
        if len(self._arms) == 1:
            return NOBODY
        other = self._arms[1 - number]
        return other.resting(other.home if other_q is None else other_q)

    def _way_home(
        self, number: int, corners: list[FloatArray], seed: int, other_q: FloatArray | None = None
    ) -> _Part | None:
        segments = self._arms[number].go_home(self._q[number], corners, seed, self._beside(number, other_q))
        if isinstance(segments, str):
            return None
        still = Trajectory(t=np.zeros(1), q=self._q[number][None], qd=np.zeros((1, self._q.shape[1])))
        return _Part(path=timed_path(segments or (still,), STEP_S), chore=None)

    def _all_home(self) -> None:
        """Both arms, as far as they can; the second does not count on the first one's resting where it is now."""
        corners = [self._world.object_corners(k) for k in range(self.tally.n_objects)]
        if len(self._arms) == 1:
            self._play([self._way_home(0, corners, self._seed)], None)
            return
        first, second = self._way_home(0, corners, self._seed, self._q[1]), self._way_home(1, corners, self._seed)
        if first is not None and second is not None:
            found = self._scheduled(first, second)
            if found.solved and self._confirmed(first, second, found):
                self._play([first, second], found)

    def _play(self, parts: list[_Part | None], found: Schedule | None) -> None:
        """Let the arms move as agreed."""
        lasts = [part.path.duration_s for part in parts if part is not None]
        if not lasts:
            return
        duration = found.makespan_s if found is not None else max(lasts)
        begin = self._world.ticks
        holding = [-1] * len(parts)
        while (self._world.ticks - begin) * TICK_S < duration:
            now, after = ((self._world.ticks - begin + k) * TICK_S for k in (0, 1))
            q, qd = self._q.copy(), np.zeros_like(self._q)
            for number, part in enumerate(parts):
                if part is None:
                    continue
                at = [
                    found.along_s(number, t) if found is not None else min(t, part.path.duration_s)
                    for t in (now, after)
                ]
                q[number], qd[number] = part.path.state(at[1])
                if at[1] <= at[0]:
                    qd[number] = 0.0
                if part.chore is not None:
                    starts = part.path.starts
                    begins, ends = (starts[segment] * STEP_S for segment in (part.chore.grips_at, part.chore.frees_at))
                    self._grip[number] = begins <= at[1] < ends
            self._step(q, qd)
            for number, thing in enumerate(self._world.held()):
                holding[number] = thing if thing >= 0 else holding[number]
        for number, part in enumerate(parts):
            if part is None:
                continue
            self._q[number] = part.path.q[-1]
            if part.chore is not None:
                self._tries[part.chore.thing] += 1
                place = self._layout.places[self._layout.place_of[part.chore.thing]]
                if not place.holds(self._world.object_poses()[part.chore.thing, :3]):
                    self.tally.n_missed += 1
                    got = holding[number] == part.chore.thing
                    self.tally.reasons[part.chore.thing] = (
                        "the tool lost it" if got else "the tool did not get hold of it"
                    )

    def _rest(self, duration_s: float) -> None:
        for _ in range(round(duration_s / TICK_S)):
            self._step(self._q, np.zeros_like(self._q))

    def _step(self, q: FloatArray, qd: FloatArray) -> None:
        self._world.step(q, qd, self._grip)
        self._watch()

    def _count(self) -> None:
        layout, tally, poses = self._layout, self.tally, self._world.object_poses()
        inside = [layout.places[layout.place_of[k]].holds(poses[k, :3]) for k in range(tally.n_objects)]
        tally.n_sorted = sum(inside)
        tally.reasons = {k: tally.reasons.get(k, "not tried") for k, good in enumerate(inside) if not good}
        tally.sim_s = self._world.ticks * TICK_S
        tally.robot_contacts = self._world.robot_contacts
        tally.n_refused = sum(arm.n_refused for arm in self._arms)
