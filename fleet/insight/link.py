"""Link: what one robot of a chain of waits is about."""

from __future__ import annotations

from dataclasses import dataclass

from fleet.insight.causes import OWN, Cause


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
