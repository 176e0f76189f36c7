"""RowLayout: which numbers of an observation are about alike things, and which of these actions choose among."""

from __future__ import annotations

from dataclasses import dataclass

from gymnasium.spaces import Box, Discrete

from fleet.training.errors import TrainingError


@dataclass(frozen=True, kw_only=True)
class Group:
    """Alike things that an observation describes one after the other: neighbours, cells, tasks on offer."""

    first: int
    """Index of the first number of the first thing."""
    n_each: int
    """Numbers about each."""
    n_things: int | None = None
    """Things there is room for; None: of those that actions choose among, as many as there are actions besides none."""
    present: int | None = None
    """Which of a thing's numbers is greater than zero if it is there; None: one that is not there is all zeros."""


@dataclass(frozen=True, kw_only=True)
class RowLayout:
    """What an observation is made up of: numbers about the agent itself, and groups of alike things.

    Numbers that are in no group are the agent's own. The groups do not overlap.
    """

    groups: tuple[Group, ...] = ()
    chosen: int | None = None
    """Index of the group that actions choose from: action 0 is none and k the k-th thing, or, where there are as many
    actions as things, k the thing of that index; None: actions are about something else."""
    takes: bool = True
    """Whether none is chosen only where no thing is on offer: to wait costs nothing at once, which is easily mistaken
    for good."""
    unseen: tuple[int, ...] = ()
    """Numbers that a policy is not shown: to it they are 0, where numbers are normalised what they are on average."""

    def sized(self, name: str, n_observed: int, action: Box | Discrete) -> RowLayout:
        """The same with all sizes known.

        Args:
            name: Type of the agents, for errors.
            n_observed: Length of an observation.
            action: What agents do.

        Raises:
            TrainingError: The groups do not fit the observation, or the actions not the group they choose from, or a
                number that is not shown is none of the observation.
        """
        n_actions = int(action.n) if isinstance(action, Discrete) else 0
        groups = []
        for k, group in enumerate(self.groups):
            n_things = group.n_things
            if n_things is None and k == self.chosen:
                n_things = n_actions - 1
            if n_things is None or n_things < 1:
                raise TrainingError(f"layout of {name}: group {k} has {n_things} things; valid: an integer >= 1")
            groups.append(Group(first=group.first, n_each=group.n_each, n_things=n_things, present=group.present))
        taken = sorted((one.first, one.first + (one.n_things or 0) * one.n_each) for one in groups)
        ends = [0, *(end for _, end in taken)]
        starts = [*(start for start, _ in taken), n_observed]
        if any(start < end for start, end in zip(starts, ends, strict=True)):
            raise TrainingError(
                f"layout of {name}: groups take {taken} of {n_observed} numbers; valid: inside, none twice"
            )
        if self.chosen is not None:
            n_things = groups[self.chosen].n_things or 0
            if n_actions - n_things not in (0, 1):
                raise TrainingError(
                    f"layout of {name}: {n_actions} actions choose among {n_things} things; "
                    f"valid: as many, or one more for none"
                )
        for number in self.unseen:
            if not 0 <= number < n_observed:
                raise TrainingError(f"layout of {name}: number {number} is unseen; valid: from 0 to {n_observed - 1}")
        return RowLayout(groups=tuple(groups), chosen=self.chosen, takes=self.takes, unseen=self.unseen)

    def own(self, n_observed: int) -> list[int]:
        """Indices of the numbers that are in no group, ascending."""
        taken = {k for one in self.groups for k in range(one.first, one.first + (one.n_things or 0) * one.n_each)}
        return [k for k in range(n_observed) if k not in taken]
