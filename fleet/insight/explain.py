"""Explain: why a robot waits, as the chain of who waits for whom, its root, and what would release it."""

from __future__ import annotations

from dataclasses import dataclass

from fleet.insight.cause_log import TICK, CauseLog
from fleet.insight.causes import DETAILS, NO_WAIT, NONE, OWN, WITHOUT_TASK, Cause, Column
from fleet.insight.codebook import Codebook, OutsideRun
from fleet.insight.link import Link
from fleet.insight.phrases import in_the_way, predicate, reason, release


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
    robot_number, tick = codebook.robot(robot), codebook.tick(time_s, log.end_tick)
    numbers: list[int] = []
    chain: list[Link] = []
    while robot_number != NONE and robot_number not in numbers:
        numbers.append(robot_number)
        change = log.number(robot_number, tick)
        if change == NONE:
            break  # a file that does not begin at the beginning
        chain.append(_link(log.change(change), _since_tick(log, change), tick, codebook))
        robot_number = log.change(change)[2 + Column.BY]
        if len(chain) > 1 and chain[-1].cause in WITHOUT_TASK:
            robot_number = NONE
    if not chain:
        raise OutsideRun(f"time is {time_s:g} s: nothing is told of {robot} then; valid: a later time")
    cycle = numbers[numbers.index(robot_number) :] if robot_number in numbers[: len(chain)] else []
    if cycle and chain[-len(cycle)].cause in WITHOUT_TASK:
        cycle = []  # it stands in the way of others, but does not wait for them: it goes as soon as it can
    return Explanation(
        robot=robot,
        time_s=time_s,
        chain=tuple(chain),
        cycle=tuple(codebook.robots[k] for k in cycle),
    )


def _since_tick(log: CauseLog, change: int) -> int:
    """Since when a robot has been about the like of a change."""
    kind = _kind(log.change(change))
    while (before := log.before(change)) != NONE and _kind(log.change(before)) == kind:
        change = before
    return log.change(change)[TICK]


def _kind(change: list[int]) -> int:
    """The same number for all causes of waiting, one of its own for each other."""
    cause = Cause(change[2 + Column.CAUSE])
    return int(cause) if cause in OWN else NONE


def _link(change: list[int], since_tick: int, tick: int, codebook: Codebook) -> Link:
    _, robot, cause, by, cell, place, until, task, detail = change
    names = codebook.robots
    return Link(
        robot=names[robot],
        cause=Cause(cause),
        by="" if by == NONE else names[by],
        cell=codebook.cell(cell),
        place=codebook.place(place),
        since_s=since_tick * codebook.tick_s,
        left_s=None if until == NONE else max(0.0, (until - tick) * codebook.tick_s),
        task="" if task == NONE else codebook.task_name(task),
        detail=DETAILS[detail],
    )
