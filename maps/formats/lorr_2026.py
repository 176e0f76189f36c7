"""League of Robot Runners 2026: what a problem says of actions that take several ticks and of robots that are delayed.

Source: Input_Output_Format.md, DelayGenerator.cpp and Simulator.cpp of https://github.com/MAPF-Competition/Start-Kit,
tag v3.1.0.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt

from maps.formats.lorr_files import Ints, ProblemKeys

VERSION = "2026 LoRR"
BERNOULLI, POISSON = "bernoulli", "poisson"
UNIFORM, GAUSSIAN = "uniform", "gaussian"
SEGMENT = 100
"""Ticks of a segment of a path in a result file."""
MOST_TICKS = 1000
"""Most ticks that an action or the shortest delay may take; the League's own problems have 3 and 1 to 15."""
LONGEST_DELAY = 1_000_000
"""Longest delay [ticks]."""
MOST_SPREAD = 100.0
"""Largest standard deviation of a delay, as a share of the range it is cut to; the League's own problems have 0.22."""


@dataclass(frozen=True, kw_only=True)
class Delays:
    """Which robots stand still for how long, at random."""

    seed: int
    shortest: int
    longest: int
    """Ticks that a delay takes, both included."""
    events: Literal["bernoulli", "poisson"]
    """Whether robots are drawn one by one in each tick, or how many of them are."""
    chance: float
    """That a robot without a delay gets one in a tick; with `poisson`, share of the team that does on average."""
    durations: Literal["uniform", "gaussian"]
    mean: float
    spread: float
    """Mean and standard deviation of a Gaussian duration, as shares of the range it is cut to."""


@dataclass(frozen=True, kw_only=True)
class Ticks:
    """How a run of 2026 passes: in ticks, of which an action takes several."""

    per_action: int
    """Ticks that a robot needs to go one cell ahead or to turn a quarter."""
    size: float
    """Edge of the square that a robot takes up [cells], > 0 and <= 1."""
    delays: Delays


@dataclass(frozen=True, kw_only=True, eq=False)
class TickedRun:
    """What a result file of 2026 says beyond those of the years before; n robots."""

    poses: Ints
    """Row, column, heading as `maps.grid` counts and ticks of the action under way of each robot, at the begin of each
    segment of `SEGMENT` ticks, shape (s, n, 4)."""
    delays: Ints
    """Robot, first tick and the tick after the last one of each delay, shape (k, 3)."""


def read_ticks(keys: ProblemKeys) -> Ticks:
    """Read what is new in a problem file of 2026.

    Raises:
        LeagueError: A key is missing or has a wrong value.
    """
    delay = keys.section("delayConfig")
    shortest = delay.whole("minDelay", least=1, most=MOST_TICKS)
    gaussian = delay.choice("durationModel", (UNIFORM, GAUSSIAN)) == GAUSSIAN
    return Ticks(
        per_action=keys.whole("agentCounter", least=1, most=MOST_TICKS, default=10),
        # Squares wider than a cell would overlap those of robots that stand beside them.
        size=keys.number("agentSize", default=1.0, most=1.0),
        delays=Delays(
            seed=delay.whole("seed", least=0, most=2**32 - 1),
            shortest=shortest,
            longest=delay.whole("maxDelay", least=shortest, most=LONGEST_DELAY),
            events="poisson" if delay.choice("eventModel", (BERNOULLI, POISSON)) == POISSON else "bernoulli",
            chance=delay.share("pDelay"),
            durations="gaussian" if gaussian else "uniform",
            mean=delay.share("gaussMeanRatio"),
            spread=delay.share("gaussStdRatio", most=MOST_SPREAD),
        ),
    )


def segment_paths(actions: npt.NDArray[np.int8], poses: Ints, letters: str) -> Iterator[str]:
    """Path of each robot as the League writes it: where it is at the begin of each segment, and runs of actions.

    Args:
        actions: Action of each robot in each tick, shape (T, n).
        poses: As in `TickedRun`.
        letters: Letter of each action.
    """
    for robot in range(actions.shape[1]):
        yield "".join(
            _segment(first, actions[first : first + SEGMENT, robot], pose[robot].tolist(), letters)
            for first, pose in zip(range(0, len(actions), SEGMENT), poses, strict=True)
        )


def delay_lists(delays: Ints, n_robots: int) -> Iterator[list[list[int]]]:
    """First tick and the tick after the last one of the delays of each robot."""
    by_robot = delays[np.argsort(delays[:, 0], kind="stable")]
    ends = np.searchsorted(by_robot[:, 0], np.arange(n_robots + 1))
    for robot in range(n_robots):
        yield by_robot[ends[robot] : ends[robot + 1], 1:].tolist()


def _segment(first: int, actions: npt.NDArray[np.int8], pose: list[int], letters: str) -> str:
    row, col, heading, ticks = pose
    begins = np.flatnonzero(np.diff(actions, prepend=-1))
    runs = zip(actions[begins].tolist(), np.diff(begins, append=len(actions)).tolist(), strict=True)
    # They count headings clockwise.
    place = f"{first},{row},{col},{-heading % 4},{ticks}"
    return f"[({place}):({','.join(f'{letters[action]} {count}' for action, count in runs)})]"
