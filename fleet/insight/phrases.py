"""Phrases: what one robot of a chain of waits is about, as a person would say it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from fleet.insight.causes import OWN, WITHOUT_TASK, Cause

Phrase = Callable[["Link"], str]


@dataclass(frozen=True, kw_only=True)
class Link:
    """What one robot of a chain is about."""

    robot: str
    cause: Cause
    by: str
    """The robot that it waits for; empty if it waits for none."""
    cell: tuple[int, int] | None
    """Row and column of the cell it cannot enter, or that is blocked."""
    place: str
    """Station, charger or parking place; empty for none."""
    since_s: float
    """Since when it waits, whatever for; of one that does not wait, since when it is about this [s]."""
    left_s: float | None
    """Time until this is over, as far as it is known [s]."""
    task: str
    """Of a robot without a task the one that it could have, else its own; empty for none."""
    detail: str
    """A word of `fleet.insight.causes.DETAILS`."""

    @property
    def waits(self) -> bool:
        """Whether something keeps the robot from what it is about."""
        return self.cause not in OWN


_FAULTS = {
    "dead": "is dead",
    "battery_empty": "is dead, its battery is empty",
    "off_lane": "is off its lane",
    "tray_loaded": "is out of service with a parcel in its tray",
    "pod_loaded": "is out of service with a pod on its plate",
    "stopped": "is told to stand still",
    "out": "was taken out of service",
    "below_arm": "stands below {by}",
}
_MENDED = {
    "out": "has to be taken back into service",
    "stopped": "has to be let go on",
}
"""What ends a fault that is none of the robot's own."""
_PODS = {"lifts": "lifts a pod", "sets_down": "sets down a pod"}
_IDLE = {
    "": "none is open",
    "next_round": "{task} has not been given out since it is free",
    "not_released": "none is open, {task} will be the next{left}",
    "waits_for_predecessor": "{task} has to wait for a task before it{of_by}",
    "station_full": "{task} has to wait, because {place} takes no more cars at {by}",
    "station_closed": "{task} has to wait, because {place} is closed{closed_by}",
    "no_way": "it has no way to {task}: {blocked}",
    "unreachable": "nobody has a way to {task}: {blocked}",
    "too_heavy": "{task} is too heavy for it",
    "lacks_capability": "it lacks a capability that {task} needs",
    "low_charge": "it has too little charge for {task}",
    "planned_later": "it is to have {task} later",
    "other_car": "{task} is kept for the car that did the leg before",
    "kept_for_leg": "it is kept for the next leg of its order",
    "shunned": "{task} was taken from it before",
    "not_offered": "{task} has to wait for room at a station",
    "no_capable_car": "every car that could do {task} is out of service",
    "cars_charge": "every car that could do {task} has to charge before",
}
_LEFT_OVER = "the allocator has not given it {task}"


def reason(link: Link) -> str:
    """What keeps a robot, as a sentence that may end in the robot it waits for."""
    return _REASONS[link.cause](link)


def in_the_way(link: Link) -> str:
    """What is said of a robot that another waits for, to follow `which`."""
    return "has no task" if link.cause in WITHOUT_TASK else predicate(link)


def predicate(link: Link) -> str:
    """The same, to follow the robot's name."""
    return _PREDICATES[link.cause](link) if link.cause in _PREDICATES else f"waits: {reason(link)}"


def release(chain: Sequence[Link]) -> str:
    """What would release the first robot of a chain that has an end."""
    root = chain[-1]
    waits = chain[-2] if len(chain) > 1 else root
    in_the_way = len(chain) > 1 and root.cause in WITHOUT_TASK
    if root.cause in _RELEASES and not in_the_way:
        return _RELEASES[root.cause](root)
    if waits.cell is not None:
        return f"{root.robot} has to leave cell {waits.cell}"
    if waits.cause is Cause.AWAITS:
        return f"{root.robot} has to come to {waits.place}"
    if root.place == waits.place and not in_the_way:
        return f"{root.robot} has to be done at {waits.place} and leave it"
    return f"{root.robot} has to leave {waits.place or 'its place'}"


def _left(link: Link, before: str = " in ") -> str:
    return "" if link.left_s is None else f"{before}{link.left_s:.1f} s"


def _needs(link: Link) -> str:
    slow = "is slow and " if link.detail == "slow" else ""
    return f"{slow}needs {link.left_s:.1f} s more" if link.left_s is not None else f"{slow}is at work"


def _fault(link: Link) -> str:
    return _FAULTS.get(link.detail, "is out of service").format(by=link.by)


def _recovers(link: Link) -> str:
    return "has to be repaired" if link.robot.startswith("arm_") else "has to be taken out of the way, or to recover"


def _visits(link: Link) -> str:
    return f"{_PODS.get(link.detail, 'stands')} at {link.place or 'its place'} for {link.task}"


def _blocked(link: Link) -> str:
    if link.cell is None:
        return "there is none on this floor"
    return f"cell {link.cell} is blocked" + (f" by {link.by}" if link.by else "")


def _idle(link: Link) -> str:
    if link.robot.startswith("arm_"):  # cars bring it tasks
        return f"no car is bound for {link.place}"
    pattern = _IDLE.get(link.detail, _LEFT_OVER)
    if not link.task and link.detail:
        pattern = _IDLE[""]
    return pattern.format(
        task=link.task,
        place=link.place,
        by=link.by,
        left=_left(link),
        of_by=f", that of {link.by}" if link.by else "",
        closed_by=f" by {link.by}" if link.by else "",
        blocked=_blocked(link),
    )


def _free(link: Link) -> str:
    if link.robot.startswith("arm_"):
        return f"a car has to be sent to {link.place}"
    if link.detail in ("no_way", "unreachable"):
        return f"cell {link.cell} has to be cleared" if link.cell else "the site needs a way there"
    if link.detail == "station_closed":
        return f"{link.place} has to be opened"
    if link.detail in ("too_heavy", "lacks_capability", "other_car", "no_capable_car"):
        return "a task that it can do has to come"
    if link.detail in ("", "not_released"):
        return f"the next task has to be released{_left(link, ', which is in ')}"
    return f"{link.task or 'a task'} has to be given to it"


_REASONS: dict[Cause, Phrase] = {
    Cause.DRIVES: lambda link: "it is driving",
    Cause.SETS_OFF: lambda link: "it has what it needs, and is about to go on",
    Cause.CELL: lambda link: f"cell {link.cell} is granted to {link.by}",
    Cause.TURN: lambda link: f"in cell {link.cell} its turn comes after {link.by}",
    Cause.CLOSED: lambda link: f"dock {link.place or link.cell} is closed by {link.by}",
    Cause.BLOCKED: lambda link: f"it has no way: {_blocked(link)}",
    Cause.YIELDS: lambda link: f"in cell {link.cell} the planner lets go first {link.by}",
    Cause.PLAN_LATE: lambda link: f"its plan has not come yet{_left(link, ', it is due in ')}",
    Cause.HALTED: lambda link: f"in its way stands {link.by}",
    Cause.STATION_FULL: lambda link: f"{link.place} has no room beside {link.by}",
    Cause.ARM_BUSY: lambda link: f"at {link.place} others come first to {link.by}",
    Cause.ARM: lambda link: f"at dock {link.place} it needs {link.by}",
    Cause.SLOT: lambda link: f"at {link.place} no slot is free{_left(link, ', the next will be in ')}",
    Cause.SERVED: lambda link: f"at dock {link.place} it is served by {link.by}",
    Cause.CHARGER: lambda link: (
        f"its charge is low, and {link.place or 'a charger'} is taken by {link.by}"
        if link.by
        else "its charge is low, and it waits for a charger"
    ),
    Cause.CHARGES: lambda link: f"it charges at {link.place}{_left(link, ' for ')}",
    Cause.VISITS: lambda link: f"it {_visits(link)}{_left(link, ' for ')}",
    Cause.NO_TASK: _idle,
    Cause.FAULT: lambda link: f"it {_fault(link)}",
    Cause.WORKS: lambda link: f"it {_needs(link)}",
    Cause.AWAITS: lambda link: f"at {link.place} it awaits {link.by}",
    Cause.OTHER_ARM: lambda link: f"over the dock of {link.place} moves {link.by}",
}
_PREDICATES: dict[Cause, Phrase] = {
    Cause.DRIVES: lambda link: f"is driving{f' to {link.place}' if link.place else ''}",
    Cause.SETS_OFF: lambda link: "has what it needs, and is about to go on",
    Cause.CELL: lambda link: f"waits for cell {link.cell}, granted to {link.by}",
    Cause.TURN: lambda link: f"waits for its turn in cell {link.cell} after {link.by}",
    Cause.CLOSED: lambda link: f"waits for dock {link.place or link.cell}, closed by {link.by}",
    Cause.YIELDS: lambda link: f"lets go first in cell {link.cell} {link.by}",
    Cause.PLAN_LATE: lambda link: f"waits for its plan{_left(link, ', due in ')}",
    Cause.SERVED: lambda link: f"is served at dock {link.place} by {link.by}",
    Cause.CHARGES: lambda link: (
        f"charges at {link.place}{_left(link, ' and needs ')}{'' if link.left_s is None else ' more'}"
    ),
    Cause.VISITS: lambda link: f"{_visits(link)}{_left(link, ', for ')}",
    Cause.NO_TASK: lambda link: f"has no task: {_idle(link)}",
    Cause.FAULT: _fault,
    Cause.WORKS: _needs,
    Cause.AWAITS: lambda link: f"awaits {link.by}",
    Cause.OTHER_ARM: lambda link: f"waits until out of its way is {link.by}",
}
_RELEASES: dict[Cause, Phrase] = {
    Cause.BLOCKED: lambda link: f"cell {link.cell} has to be cleared" if link.cell else "the site needs a way there",
    Cause.PLAN_LATE: lambda link: f"the plan of {link.robot} has to land{_left(link, ', which is in ')}",
    Cause.SLOT: lambda link: f"a parcel has to leave {link.place}{_left(link, ', which is in ')}",
    Cause.CHARGER: lambda link: "a charger has to become free",
    Cause.CHARGES: lambda link: f"{link.robot} has to be charged{_left(link, ', which takes ')}",
    Cause.VISITS: lambda link: f"{link.robot} has to leave {link.place or 'its place'}{_left(link)}",
    Cause.NO_TASK: _free,
    Cause.FAULT: lambda link: f"{link.robot} {_MENDED.get(link.detail) or _recovers(link)}",
    Cause.WORKS: lambda link: f"{link.robot} has to end its transfer{_left(link, ', which takes ')}",
}
