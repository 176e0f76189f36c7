"""A whole window of multi-step PIBT in one kernel: in a small fleet, calling one for each part of every timestep takes
longer than what they do."""

from __future__ import annotations

from typing import NamedTuple

from planners.mapf.arrays import IntArray
from planners.mapf.chance import Chance, next_word
from planners.mapf.kernel import kernel
from planners.mapf.multi_step.multi_step_kernel import (
    Aims,
    Choices,
    Costs,
    Look,
    Wishes,
    begin,
    first_states,
    go_on,
    lock,
    reconsider,
    sweep,
)
from planners.mapf.multi_step.operations import Operations
from planners.mapf.window import WindowAgents, WindowTurns, take_turns


class StepSearch(NamedTuple):
    """How operations are looked for."""

    behind: Look
    """See `Aims`, as for what follows."""
    reach: int
    crowd: IntArray
    chance: Chance
    patience: int
    most_tries: int
    allow_rotation: bool


@kernel
def plan_steps(
    ops: Operations,
    choices: Choices,
    search: StepSearch,
    costs: Costs,
    wishes: Wishes,
    agents: WindowAgents,
    turns: WindowTurns,
    impatience: float,
    state_cell: IntArray,
    states: IntArray,
) -> None:  # pragma: no cover - compiled
    """Fill in the states after each timestep, shape (timesteps + 1, n), from the first row on."""
    n = states.shape[1]
    for agent in range(n):
        choices.state[agent] = states[0, agent]
    begin(ops, choices, state_cell)
    for done in range(states.shape[0] - 1):
        take_turns(turns, states[done], agents, done, impatience)
        lock(ops, choices, turns.locked, state_cell)
        for place in range(n):
            choices.place[turns.order[place]] = place
        salt = next_word(search.chance)
        aims = Aims(costs.table, search.behind, wishes, search.reach, search.crowd, salt, search.chance)
        reconsider(ops, choices, search.patience)
        sweep(ops, choices, aims, turns.order, search.most_tries, state_cell, search.allow_rotation)
        first_states(ops, choices, costs, wishes, states[done + 1])
        go_on(ops, choices, states[done + 1])
