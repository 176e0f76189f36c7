"""Explain: why a robot waits, as the chain of who waits for whom, its root, and what would release it."""

from __future__ import annotations

from dataclasses import dataclass

from fleet.insight.cause_log import TICK, CauseLog
from fleet.insight.causes import DETAILS, NO_WAIT, NONE, OWN, WITHOUT_TASK, Cause, Column
from fleet.insight.codebook import Codebook, OutsideRun
from fleet.insight.phrases import Link, in_the_way, predicate, reason, release

_CAUSES = tuple(Cause)
_KINDS = tuple(int(cause) if cause in OWN else NONE for cause in Cause)
"""The same number for all causes of waiting, one of its own for each other."""


@dataclass(frozen=True, kw_only=True)
class Explanation:
    """Why a robot waits at a time, if it does; its `str` says it in a sentence."""

    robot: str
    time_s: float
    chain: tuple[Link, ...]
    """The robot, the one that it waits for, and so on; ends at the root, or before the first that comes again."""
    cycle: tuple[str, ...]
    """Robots that wait for each other in a circle; empty if the chain has an end."""

    @property
    def waits(self) -> bool:
        """Whether something keeps the robot."""
        return self.chain[0].waits

    @property
    def waited_s(self) -> float:
        """How long it has waited by then; 0 if it does not [s]."""
        return self.time_s - self.chain[0].since_s if self.waits else 0.0

    @property
    def root(self) -> Link:
        """The end of the chain: what has to change for the whole of it to go on."""
        return self.chain[-1]

    @property
    def release(self) -> str:
        """What would release the robot, in words; empty if nothing keeps it."""
        if self.cycle:
            return f"one of {', '.join(self.cycle)} has to give way"
        return release(self.chain) if self.chain[0].cause not in NO_WAIT else ""

    @property
    def orders(self) -> str:
        """The orders that the robots of the chain work on, each with those; empty if there are none."""
        robots: dict[str, list[str]] = {}
        for link in self.chain:
            if link.task and link.cause not in WITHOUT_TASK:
                robots.setdefault(link.task, []).append(link.robot)
        return ", ".join(f"{order} ({', '.join(names)})" for order, names in robots.items())

    def __str__(self) -> str:
        first = self.chain[0]
        lasts_s = self.time_s - first.since_s
        if first.waits:
            words = [f"{self.robot} has waited {lasts_s:.1f} s: {reason(first)}"]
        elif first.cause in NO_WAIT:
            words = [f"{self.robot} {predicate(first)}"]
        else:
            words = [f"{self.robot}, for {lasts_s:.1f} s now, {predicate(first)}"]
        words += [f"which {in_the_way(link)}" for link in self.chain[1:]]
        text = ", ".join(words)
        if self.cycle:
            text += f"; they wait for each other in a circle: {' -> '.join((*self.cycle, self.cycle[0]))}"
        return text


def explain(log: CauseLog, codebook: Codebook, robot: str, time_s: float) -> Explanation:
    """Say why a robot waits.

    Every robot waits for at most one other at a time, the one that holds what it needs next; so who waits for whom is a
    chain, and it has an end unless robots wait for each other in a circle.

    Args:
        log: Causes of the run.
        codebook: What their numbers stand for.
        robot: Such as ``car_2`` or ``arm_0``.
        time_s: When [s].

    Returns:
        Also for a robot that does not wait.

    Raises:
        UnknownRobot: There is no such robot.
        OutsideRun: The run was not under way then.
    """
    return Explainer(log, codebook, time_s).explain(codebook.robot(robot))


class Explainer:
    """Explains any number of robots at one time of a run; those that wait for the same share its links.

    Args:
        log: Causes of the run.
        codebook: What their numbers stand for.
        time_s: When [s].

    Raises:
        OutsideRun: The run was not under way then.
    """

    def __init__(self, log: CauseLog, codebook: Codebook, time_s: float) -> None:
        self._log, self._codebook, self._time_s = log, codebook, time_s
        self._tick = codebook.tick(time_s, log.end_tick)
        self._links: dict[int, tuple[Link, int] | None] = {}

    def explain(self, robot: int) -> Explanation:
        """Say why a robot waits, as the function of that name.

        Args:
            robot: Its number.

        Raises:
            OutsideRun: Nothing is told of it at that time.
        """
        names = self._codebook.robots
        numbers: list[int] = []
        chain: list[Link] = []
        by = robot
        while by != NONE and by not in numbers:
            numbers.append(by)
            found = self._link(by)
            if found is None:
                break  # a file that does not begin at the beginning
            link, by = found
            chain.append(link)
            if len(chain) > 1 and link.cause in WITHOUT_TASK:
                by = NONE
        if not chain:
            raise OutsideRun(f"time is {self._time_s:g} s: nothing is told of {names[robot]} then; valid: a later time")
        cycle = numbers[numbers.index(by) :] if by in numbers[: len(chain)] else []
        if cycle and chain[-len(cycle)].cause in WITHOUT_TASK:
            cycle = []  # it stands in the way of others, but does not wait for them: it goes as soon as it can
        return Explanation(
            robot=names[robot],
            time_s=self._time_s,
            chain=tuple(chain),
            cycle=tuple(names[k] for k in cycle),
        )

    def _link(self, robot: int) -> tuple[Link, int] | None:
        """What a robot is about, and the number of the one that it waits for; None if nothing is told of it."""
        if robot not in self._links:
            change = self._log.number(robot, self._tick)
            self._links[robot] = None if change == NONE else self._made(change)
        return self._links[robot]

    def _made(self, number: int) -> tuple[Link, int]:
        codebook = self._codebook
        change = self._log.change(number)
        _, robot, cause, by, cell, place, until, task, detail = change
        link = Link(
            robot=codebook.robots[robot],
            cause=_CAUSES[cause],
            by="" if by == NONE else codebook.robots[by],
            cell=codebook.cell(cell),
            place=codebook.place(place),
            since_s=self._since_tick(number, change) * codebook.tick_s,
            left_s=None if until == NONE else max(0.0, (until - self._tick) * codebook.tick_s),
            task="" if task == NONE else codebook.task_name(task),
            detail=DETAILS[detail],
        )
        return link, by

    def _since_tick(self, number: int, change: list[int]) -> int:
        """Since when a robot has been about the like of a change."""
        kind = _KINDS[change[2 + Column.CAUSE]]
        while (number := self._log.before(number)) != NONE:
            before = self._log.change(number)
            if _KINDS[before[2 + Column.CAUSE]] != kind:
                break
            change = before
        return change[TICK]
