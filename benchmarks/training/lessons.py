"""Lessons: what the benchmark trains and for how long, where it is played then, and what it should come to."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from benchmarks.training.due_dates import HELD_OUT_SITES
from benchmarks.training.goals import Gap, Goal, Mean, Saved, Success, TimesScript
from fleet.envs.dispatch.scenarios import SCENARIOS
from fleet.training.results import RANDOM, SCRIPTED

RULES = ("nearest", "greedy", "hungarian", "regret_lns", "scored_matching", "rollout")
"""Policies of dispatch beside the recipe's script."""


@dataclass(frozen=True, kw_only=True)
class Place:
    """Where what was learned is played as well, by the script, too."""

    arguments: Mapping[str, Any] = field(default_factory=dict)
    """Of the environment, over those of the training."""
    n_episodes: int | None = None
    """At most; None: all. An episode takes seconds in physics."""
    policies: tuple[str, ...] = ()
    """What else plays: `random`, or policies of dispatch."""
    goals: tuple[Goal, ...]


@dataclass(frozen=True, kw_only=True)
class Lesson:
    """A recipe that is trained from several seeds."""

    figure: str
    """Column of the episodes that is told of all policies."""
    minutes: float
    """Longest time of a seed on one core."""
    n_episodes: int
    """Of the evaluation of each seed."""
    fidelity: str = "kinematic"
    """In which it is evaluated where it was learned; a quick run learns in no other."""
    goals: tuple[Goal, ...] = ()
    """Where it was learned."""
    level_with: tuple[str, ...] = ()
    """Policies that should not be better, by more than 2 % of a script's figure."""
    places: Mapping[str, Place] = field(default_factory=dict)
    """By name."""
    has_curve: bool = True
    """Whether most episodes of the training are like those of the evaluation; else a curve of them says nothing."""

    @property
    def success(self) -> Success | None:
        """What counts successes; None where episodes are none and no failures."""
        return next((goal for goal in self.goals if isinstance(goal, Success)), None)


def _navigated(places: str) -> tuple[Goal, ...]:
    return TimesScript(figure="places", target=places), TimesScript(figure="touches", target="<= 1.0")


def _gap(n_episodes: int, **arguments: Any) -> Place:
    """Where all rules and the rollout play as well."""
    goals = (Gap(figure="tardiness_min", target=">= 0.5"),)
    return Place(arguments=arguments, n_episodes=n_episodes, policies=RULES, goals=goals)


def _docking(minutes: float) -> Lesson:
    docked = ("docked",)
    return Lesson(
        figure="docked",
        minutes=minutes,
        n_episodes=100,
        goals=(Success(figures=docked, target=">= 0.95"),),
        places={"physics": Place(arguments=PHYSICS, goals=(Success(figures=docked, target=">= 0.9"),))},
    )


PHYSICS = {"fidelity": "physics"}
SLACK_S = 3.64
"""Of a hand-over of the script in physics, the time in which the arm is not at its limits: see `slack` [s]."""
LESSONS: dict[str, Lesson] = {
    "navigate": Lesson(
        figure="places",
        minutes=60,
        n_episodes=40,
        level_with=(SCRIPTED, RANDOM),
        places={
            "physics": Place(arguments=PHYSICS, n_episodes=20, goals=_navigated(">= 1.1")),
            "another site, physics": Place(
                arguments={"site": "medium", "n_cars": 8, **PHYSICS}, n_episodes=20, goals=_navigated(">= 1.05")
            ),
            "another team, physics": Place(
                arguments={"n_cars": 12, **PHYSICS}, n_episodes=20, goals=_navigated(">= 1.05")
            ),
        },
    ),
    "dispatch": Lesson(figure="delivered", minutes=30, n_episodes=40, fidelity="grid", level_with=(SCRIPTED, RANDOM)),
    "reach": Lesson(
        figure="is_success",
        minutes=15,
        n_episodes=100,
        goals=(Success(figures=("is_success",), target=">= 0.95"),),
        level_with=(RANDOM,),  # nobody can do better than a script that never fails
        places={
            "physics": Place(
                arguments=PHYSICS,
                policies=(RANDOM,),
                goals=(Success(figures=("is_success",), target=">= 0.95"),),
            )
        },
    ),
    "dock": _docking(minutes=10),
    "approach": _docking(minutes=15),
    "transfer": Lesson(
        figure="loaded",
        minutes=30,
        n_episodes=50,
        # No car is an agent, so that a parcel is paid for once: to the arm that picked or set it.
        goals=(Success(figures=("loaded", "delivered"), of="parcels", target=">= 0.9"),),
        places={
            "physics": Place(
                arguments=PHYSICS,
                goals=(Success(figures=("loaded", "delivered"), of="parcels", target=">= 0.85"),),
            )
        },
    ),
    "cell": Lesson(
        figure="deliveries",
        minutes=60,
        n_episodes=20,
        places={"physics": Place(arguments=PHYSICS, goals=(Mean(figure="deliveries", target=">= 1.6"),))},
    ),
    "residual": Lesson(
        figure="deliveries",
        minutes=60,
        n_episodes=20,
        has_curve=False,
        places={
            "physics": Place(
                arguments=PHYSICS,
                goals=(
                    TimesScript(figure="deliveries", target=">= 1.0"),
                    # The script touches nothing.
                    Mean(figure="contact", target=">= 0"),
                    Saved(figure="handover_s", count="handovers", slack=SLACK_S, target=">= 0.5"),
                ),
            )
        },
    ),
    "handover": Lesson(
        figure="parcels_delivered",
        minutes=60,
        n_episodes=20,
        places={"physics": Place(arguments=PHYSICS, n_episodes=5, goals=())},
    ),
    "dispatch_due": Lesson(
        figure="tardiness_min",
        minutes=60,
        n_episodes=100,
        fidelity="grid",
        places={
            # Episodes differ by hours of tardiness, and there are minutes to win.
            "skewed waves": _gap(100, **SCENARIOS["due_waves"].arguments),
            # Most of what is late is late in few episodes.
            "beside all rules": _gap(60),
            **{name: _gap(60, floor=floor) for name, floor in HELD_OUT_SITES.items()},
        },
    ),
}
"""What is trained, by recipe; each is a group of the benchmark."""
