"""Recipe: an environment, how it is learned stage by stage, and what it is measured against."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, fields
from typing import TYPE_CHECKING, Any, Literal, TypeVar

from fleet.config import require
from fleet.training.errors import TrainingError
from fleet.training.layout import RowLayout
from fleet.training.settings import PpoConfig

if TYPE_CHECKING:  # the command line lists recipes, and the environments take a second to load
    from _typeshed import DataclassInstance

    from fleet.envs.policies.policy import Policy
    from fleet.training.batch import AgentType, Batch

    PolicyMaker = Callable[[], Policy]
    TeacherMaker = Callable[[int], Policy]
    BatchMaker = Callable[..., Batch]

Weights = TypeVar("Weights", bound="DataclassInstance")
Play = Literal["likeliest", "drawn"]
"""How a learned policy plays: its likeliest action, or one drawn from its distribution."""


@dataclass(frozen=True, kw_only=True)
class TrainingStage:
    """A part of a training run, with arguments of its own for the environments.

    It ends when its longest time is over, or, after its shortest, when a figure has been reached; the last one goes on
    to the end of the run. Stages change at checkpoints only, so that a resumed run changes where the other did.
    """

    name: str
    arguments: Mapping[str, Any] = field(default_factory=dict)
    """Of the environment, over those of the recipe."""
    mix: tuple[Mapping[str, Any], ...] = ({},)
    """Arguments of environments that are learned on side by side, over those of the stage: the environments are dealt
    these in turn. Teams and sites may differ; agents of one type see and do the same kind of thing in all."""
    longest: float = 1.0
    """Share of the run's steps after which it ends."""
    shortest: float = 0.0
    """Share of the run's steps before which it does not end."""
    figure: str | None = None
    """Of `Recipe.figures`, or `return`; None: only time ends it."""
    reached: float = 0.0
    """The mean of the figure over the last episodes with which the stage ends, at least."""
    n_last: int = 50
    """Those episodes; there have to be as many in this stage."""

    def __post_init__(self) -> None:
        require(
            0.0 <= self.shortest <= self.longest <= 1.0, "shortest, longest", (self.shortest, self.longest), "0 to 1"
        )
        require(self.n_last >= 1, "n_last", self.n_last, "an integer >= 1")
        require(len(self.mix) >= 1, "mix", self.mix, "one set of arguments or more")


def on_floor(arguments: Mapping[str, Any], floor: Mapping[str, Any] | None) -> dict[str, Any]:
    """Arguments of an environment on a generated floor.

    Args:
        arguments: Without it.
        floor: Arguments of `maps.warehouse.generate_warehouse`; None = the site is as the arguments say.
    """
    from maps.warehouse import generate_warehouse

    return dict(arguments) if floor is None else {**arguments, "site": generate_warehouse(**floor)}


def weights_of(kind: type[Weights], told: object) -> Weights:
    """Weights of an environment's rewards.

    Args:
        kind: A dataclass of them, all with defaults.
        told: Some of them, by name; None: as they are.

    Raises:
        TrainingError: There is no such weight.
    """
    names = [one.name for one in fields(kind)]
    if told is None:
        return kind()
    if not isinstance(told, Mapping) or not set(told) <= set(names):
        raise TrainingError(f"[env]: weights is {told!r}; valid: a table of numbers for {', '.join(names)}")
    return kind(**told)


@dataclass(frozen=True, kw_only=True)
class Recipe:
    """An environment and how it is learned."""

    summary: str
    """What agents learn."""
    make: Callable[..., Any]
    """Makes the environment from its arguments."""
    scripted: PolicyMaker
    """Makes the policy to compare with."""
    script: str
    """What that one does, in words."""
    figures: tuple[str, ...]
    """Names in `infos` whose sums over an episode are reported; the first is what it is all about."""
    n_steps: int
    """Steps of agents."""
    ppo: PpoConfig
    at_end: Mapping[str, Callable[[Any], float]] = field(default_factory=dict)
    """Further figures of the evaluation: each is asked of the environment at the end of an episode."""
    shares: frozenset[str] = frozenset()
    """Those of the figures that are 0 or their weight in every episode, so that what is told is a share of episodes."""
    layouts: Mapping[str, RowLayout] = field(default_factory=dict)
    """How observations are made up, by type of agents; a type that is not named has numbers of its own only."""
    arguments: Mapping[str, Any] = field(default_factory=dict)
    """Arguments of the environment that differ from its own defaults: those of the evaluation, which stages change."""
    stages: tuple[TrainingStage, ...] = (TrainingStage(name="all"),)
    """One after the other."""
    plays: tuple[Play, ...] = ("likeliest",)
    """How what was learned plays in the evaluation; the first way is that of `load_policy`."""
    batch: BatchMaker | None = None
    """Steps environments side by side faster than one after the other: takes the arguments of each of them, then
    `figures`, `layouts` and `n_state` as `EnvBatch` does; None: there is nothing faster."""
    teacher: TeacherMaker | None = None
    """Makes the policy that is cloned for the first `PpoConfig.clone_n` steps, with a seed."""

    def environments(
        self, stage: TrainingStage, arguments: Mapping[str, Any], held: Sequence[str]
    ) -> list[dict[str, Any]]:
        """Arguments of the environments that a stage mixes.

        Args:
            stage: Of this recipe.
            arguments: Those of the run.
            held: Names of those that no stage changes.
        """
        fixed = {name: arguments[name] for name in held}
        return [{**arguments, **stage.arguments, **mixed, **fixed} for mixed in stage.mix]

    def survey(self, arguments: Mapping[str, Any], held: Sequence[str] = ()) -> tuple[tuple[AgentType, ...], int]:
        """Make every environment of every stage once, so that a mistake shows before the run begins.

        Args:
            arguments: Those of the run.
            held: Names of those that no stage changes.

        Returns:
            All types of agents, and the numbers of the longest `state()`; 0 if an environment has none.

        Raises:
            TrainingError: An environment does not know an argument, or agents of a type are not alike in all.
            ConfigError: A value is outside its valid range.
        """
        from fleet.envs.core.env_config import UnknownSetting
        from fleet.training.batch import agent_types, types_of

        wanted = [dict(arguments)]
        for stage in self.stages:
            wanted += [one for one in self.environments(stage, arguments, held) if one not in wanted]
        kinds, lengths = [], []
        for one in wanted:
            try:
                env = self.make(**one)
            except UnknownSetting as error:
                raise TrainingError(f"[env]: {error}") from error
            kinds.append(agent_types(env, self.layouts))
            space = getattr(env, "state_space", None)
            lengths.append(0 if space is None else int(space.shape[0]))
            env.close()
        return types_of(kinds), max(lengths) if all(lengths) else 0
