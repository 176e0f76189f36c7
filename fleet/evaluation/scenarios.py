"""Scenarios: what policies are compared on - environments with their arguments, seeds, and one headline figure each.

A scenario has up to three splits, as multi-robot learning has come to report them: `train` is what may be trained on,
`sites` has floors that were never seen, `teams` sizes of teams that were never seen. The episodes of a split have fixed
seeds, from `FIRST_SEED` on, in all scenarios alike, and go through the split's cases in turn: the k-th episode is the
k-th seed in case k modulo their number. Seeds below are free to train and to tune with.

A new scenario is one entry in `SCENARIOS`.

Source of the three splits: CAMAR, https://arxiv.org/abs/2508.12845.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field, replace
from typing import Any

from fleet.config import require
from fleet.envs.dispatch.scenarios import SCENARIOS as DISPATCH_SCENARIOS
from fleet.evaluation.measures import MEASURES, Measure
from fleet.training.recipes import RECIPES

FIRST_SEED = 2_000_000_000
"""Seed of the first episode of every split."""
MOST_EPISODES = 10_000
SPLITS = {
    "train": "sites and team sizes to train on",
    "sites": "floors never seen",
    "teams": "team sizes never seen",
}
"""What each split is for."""


@dataclass(frozen=True, kw_only=True)
class Hall:
    """A generated floor; as many pick stations as drop stations."""

    rows: int
    cols: int
    stations: int
    """Of each kind."""
    parking: int

    def __str__(self) -> str:
        return f"{self.rows} x {self.cols} cells, {self.stations} + {self.stations} stations"

    def site(self) -> Any:
        """The floor itself."""
        from maps.warehouse import generate_warehouse

        return generate_warehouse(
            rows=self.rows, cols=self.cols, pick=self.stations, drop=self.stations, parking=self.parking
        )


@dataclass(frozen=True, kw_only=True)
class Case:
    """Arguments of an environment that differ from episode to episode of a split."""

    site: str | Hall = ""
    """Name of a shipped site, or a floor to generate; nothing for robots without a site."""
    n_cars: int = 0

    def __str__(self) -> str:
        return ", ".join(filter(None, (str(self.site), f"{self.n_cars} cars" if self.n_cars else "")))

    def arguments(self) -> dict[str, Any]:
        """As the environment takes them."""
        site = self.site.site() if isinstance(self.site, Hall) else self.site
        return {name: value for name, value in (("site", site), ("n_cars", self.n_cars)) if value}


@dataclass(frozen=True, kw_only=True)
class Scenario:
    """What policies are compared on."""

    summary: str
    """What agents do, in one line."""
    env: str
    """Environment with its version, `dispatch_v1`; or the name of a recipe of a single robot, `reach`."""
    headline: str
    """The figure that it is about; a name in `MEASURES`."""
    beside: tuple[str, ...]
    """Figures that are told with it."""
    reference: str
    """The scripted fleet: name of the policy that gains are measured from."""
    baselines: tuple[str, ...]
    """Other policies of the table of baselines, by name."""
    splits: Mapping[str, tuple[Case, ...]]
    arguments: Mapping[str, Any] = field(default_factory=dict)
    """Arguments of all its episodes."""

    @property
    def layer(self) -> str:
        """The environment without its version: a name in `fleet.envs.policies.POLICIES`."""
        return self.env.rpartition("_v")[0] or self.env

    @property
    def measures(self) -> dict[str, Measure]:
        """All its figures, the headline first."""
        return {name: MEASURES[name] for name in (self.headline, *self.beside)}

    def make(self, case: Case) -> Any:
        """Make the environment of a case."""
        arguments = {**self.arguments, **case.arguments()}
        if self.env in RECIPES:
            return RECIPES[self.env].make(**arguments)
        make: Callable[..., Any] = importlib.import_module(f"fleet.envs.{self.env}").parallel_env
        return make(**arguments)

    def case_of(self, split: str, episode: int) -> Case:
        """The case that an episode of a split is played in."""
        cases = self.splits[split]
        return cases[episode % len(cases)]

    def definition(self, split: str) -> dict[str, Any]:
        """All that decides the episodes of a split, as JSON has it."""
        return {
            "env": self.env,
            "arguments": dict(self.arguments),
            "cases": [asdict(case) for case in self.splits[split]],
            "first_seed": FIRST_SEED,
        }


def _cases(*floors: tuple[str | Hall, int]) -> tuple[Case, ...]:
    return tuple(Case(site=site, n_cars=n_cars) for site, n_cars in floors)


_ODD = Hall(rows=18, cols=26, stations=3, parking=40)
_WIDE = Hall(rows=30, cols=34, stations=6, parking=120)
_DISPATCH_RULES = ("random", "nearest", "greedy", "hungarian", "regret_lns", "rollout")


def _orders_of(name: str) -> dict[str, Any]:
    """What a scenario of dispatch says of orders, whoever delivers them."""
    told = DISPATCH_SCENARIOS[name].arguments
    return {key: value for key, value in told.items() if key not in ("site", "n_cars")}


_DISPATCH_SPLITS = {
    "train": _cases(("small", 6), ("medium", 16)),
    "sites": _cases(("twin", 6), ("dense", 12), (_ODD, 12)),
    "teams": _cases(("small", 3), ("small", 12), ("medium", 32)),
}
_DUE = Scenario(
    summary="cars choose their tasks; all can be delivered, and what counts is when",
    env="dispatch_v1",
    arguments=_orders_of("due_dates"),
    headline="tardiness",
    beside=("on_time", "delivered"),
    reference="apparent_tardiness",
    baselines=_DISPATCH_RULES,
    splits=_DISPATCH_SPLITS,
)
SCENARIOS: dict[str, Scenario] = {
    "dispatch_due": _DUE,
    "dispatch_rush": replace(
        _DUE,
        summary="cars choose their tasks; there are half as many again as they can deliver; what counts is when",
        arguments=_orders_of("due_rush"),
    ),
    "dispatch_busy": Scenario(
        summary="cars choose their tasks; there are half as many again as they can deliver; what counts is how many",
        env="dispatch_v1",
        arguments={"load": 1.5},
        headline="delivered",
        beside=("tardiness",),
        reference="nearest",
        baselines=("random", "greedy", "hungarian", "apparent_tardiness"),
        splits=_DISPATCH_SPLITS,
    ),
    "dispatch_waves": Scenario(
        summary="cars choose their tasks; orders come in waves, most from few stations, and more than can be done",
        env="dispatch_v1",
        arguments=_orders_of("due_waves"),
        headline="on_time",
        beside=("tardiness", "delivered"),
        reference="apparent_tardiness",
        baselines=_DISPATCH_RULES,
        splits={
            "train": _cases(("medium", 16)),
            "sites": _cases(("small", 6), ("dense", 12), (_ODD, 12)),
            "teams": _cases(("medium", 8), ("medium", 32)),
        },
    ),
    "traffic_dense": Scenario(
        summary="cars choose their lane moves on a crowded floor",
        env="traffic_v1",
        headline="delivered",
        beside=("jams", "refused"),
        reference="pibt",
        baselines=("random", "shortest_way", "multi_step_pibt"),
        splits={
            "train": _cases(("dense", 20), ("dense", 30)),
            "sites": _cases((_ODD, 25), ("medium", 24)),
            "teams": _cases(("dense", 10), ("dense", 40)),
        },
    ),
    "traffic_large": Scenario(
        summary="the same on a floor of 24 x 40 cells",
        env="traffic_v1",
        headline="delivered",
        beside=("jams", "refused"),
        reference="pibt",
        baselines=("random", "shortest_way", "multi_step_pibt"),
        splits={
            "train": _cases(("dense_large", 60)),
            "sites": _cases((_WIDE, 60)),
            "teams": _cases(("dense_large", 30), ("dense_large", 120)),
        },
    ),
    "navigate": Scenario(
        summary="cars drive to places, among each other, in physics",
        env="navigate_v1",
        arguments={"fidelity": "physics"},
        headline="places",
        beside=("touches", "towed"),
        reference="script",
        baselines=("random",),
        splits={
            "train": _cases(("small", 6)),
            "sites": _cases(("medium", 6), ("twin", 6)),
            "teams": _cases(("small", 3), ("small", 10)),
        },
    ),
    "dock": Scenario(
        summary="a car comes to a dock and stands within 5 cm and 0.1 rad of its stop, in physics",
        env="warehouse_v1",
        arguments={"level": "dock", "fidelity": "physics"},
        headline="docked",
        beside=("contacts", "steps"),
        reference="classical",
        baselines=("random",),
        splits={"train": (Case(site="cell"),), "sites": _cases(("small", 0), ("twin", 0))},
    ),
    "transfer": Scenario(
        summary="arms move a parcel each between rack and car by the tips of their tools, in physics",
        env="warehouse_v1",
        arguments={"level": "transfer", "arm_action": "tip", "fidelity": "physics"},
        headline="moved",
        beside=("contacts", "steps"),
        reference="pointing_arms",
        baselines=("random",),
        splits={"train": (Case(site="cell"),), "sites": _cases(("small", 0))},
    ),
    "cell": Scenario(
        summary="two cars and two arms deliver two parcels, in physics",
        env="warehouse_v1",
        arguments={"fidelity": "physics"},
        headline="parcels",
        beside=("contacts", "steps"),
        reference="classical",
        baselines=("random",),
        splits={"train": _cases(("cell", 2)), "teams": _cases(("cell", 1), ("cell", 3))},
    ),
    "car": Scenario(
        summary="one car drives to places among cars that a script drives, in physics",
        env="car",
        arguments={"fidelity": "physics"},
        headline="places",
        beside=("touches", "towed"),
        reference="script",
        baselines=("random",),
        splits={"train": (Case(site="small"),), "sites": (Case(site="medium"),)},
    ),
    "reach": Scenario(
        summary="a Kuka brings the tip of its tool to a point, in physics",
        env="reach",
        arguments={"fidelity": "physics"},
        headline="success",
        beside=("steps",),
        reference="script",
        baselines=("random",),
        splits={"train": (Case(),)},
    ),
}
"""All scenarios, by name."""


def require_episodes(n: int) -> None:
    """Refuse a number of episodes that there is not.

    Raises:
        ConfigError: It is not from 1 to `MOST_EPISODES`.
    """
    require(1 <= n <= MOST_EPISODES, "--episodes", n, f"an integer from 1 to {MOST_EPISODES}")


def scenario_named(name: str) -> Scenario:
    """The scenario of a name.

    Raises:
        ConfigError: There is none; lists the names.
    """
    require(name in SCENARIOS, "--scenario", name, ", ".join(SCENARIOS))
    return SCENARIOS[name]


def splits_named(scenario: Scenario, word: str) -> tuple[str, ...]:
    """The splits that a word means, `all` or one of them.

    Raises:
        ConfigError: The scenario has no such split.
    """
    require(word == "all" or word in scenario.splits, "--split", word, ", ".join(("all", *scenario.splits)))
    return tuple(scenario.splits) if word == "all" else (word,)
