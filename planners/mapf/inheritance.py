"""Priority inheritance with backtracking: one agent takes its best step, and whoever stands there must find one first.

The core that PIBT and the successors of LaCAM* share. What differs is how agents rank their options, and when.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from planners.mapf.arrays import IntArray
from planners.mapf.kernel import Int, inlined, kernel
from planners.mapf.options import Options
from planners.mapf.problem import NOBODY

UNDECIDED = -1
"""Where an agent goes that has not decided yet."""

PUSHED, SETTLED, STUCK = range(3)
"""How `push` ends: somebody else must decide first; all on the chain are decided; so they are, but the first agent
stays where somebody else goes."""


class Claims(NamedTuple):
    """Who has which cell in the timestep that is being decided; n agents. Between timesteps all cells are nobody's."""

    cells: IntArray
    """Who stands in each cell before the timestep and who after it, `NOBODY` = none, shape (n_cells, 2)."""
    crossed: IntArray
    """Who sweeps over each cell on the way, neither from it nor to it, shape (n_cells,); (1,) where no move does."""
    home: IntArray
    """Cell in which each agent stands, shape (n,)."""
    goes: IntArray
    """Cell that it aims at, `UNDECIDED` = not known yet, shape (n,)."""
    number: IntArray
    """Its option, counted from 1, 0 = to wait, shape (n,); holds for those that are decided."""
    stack: IntArray
    """The chain: each agent on it pushes the next one, shape (n + 1,)."""


def claims_of(options: Options, n_cells: int, n: int) -> Claims:
    """Working memory for `n` agents."""
    home, goes, number = np.full((3, n), UNDECIDED, dtype=np.int32)
    return Claims(
        cells=np.full((n_cells, 2), NOBODY, dtype=np.int32),
        crossed=np.full(n_cells if options.has_sweeps else 1, NOBODY, dtype=np.int32),
        home=home,
        goes=goes,
        number=number,
        stack=np.empty(n + 1, dtype=np.int32),
    )


@kernel
def enter(claims: Claims, agent: Int, cell: Int) -> None:  # pragma: no cover - compiled
    """Put an undecided agent on the floor."""
    claims.home[agent] = cell
    claims.cells[cell, 0] = agent
    claims.goes[agent] = UNDECIDED


@kernel
def clear(options: Options, claims: Claims, now: IntArray) -> None:  # pragma: no cover - compiled
    """Take all agents off the floor again; only cells that they touched are visited."""
    for agent in range(len(now)):
        claims.cells[claims.home[agent], 0] = NOBODY
        claims.cells[claims.home[agent], 1] = NOBODY
        if claims.goes[agent] != UNDECIDED:
            claims.cells[claims.goes[agent], 1] = NOBODY
            if options.has_sweeps:
                _uncross(options, claims, now, agent)


@kernel
def stay(claims: Claims, now: IntArray, after: IntArray, agent: Int) -> None:  # pragma: no cover - compiled
    """Decide that an agent waits."""
    home = claims.home[agent]
    claims.goes[agent] = home
    claims.number[agent] = 0
    claims.cells[home, 1] = agent
    after[agent] = now[agent]


@kernel
def go(
    options: Options, claims: Claims, now: IntArray, after: IntArray, agent: Int, number: Int
) -> None:  # pragma: no cover - compiled
    """Decide for an option, which must be allowed."""
    option = number - 1
    to = options.aim[now[agent], option, 1]
    claims.goes[agent] = to
    claims.number[agent] = number
    claims.cells[to, 1] = agent
    after[agent] = options.start[now[agent], option, 0] if options.has_turns else options.aim[now[agent], option, 0]
    if options.has_sweeps:
        move = options.sweep[now[agent], option]
        if move >= 0:
            for k in range(options.beside_ptr[move], options.beside_ptr[move + 1]):
                claims.crossed[options.beside[k]] = agent


@kernel
def is_allowed(
    options: Options, claims: Claims, now: IntArray, agent: Int, number: Int, allow_rotation: bool
) -> bool:  # pragma: no cover - compiled
    """Whether an option agrees with all that is decided so far."""
    option, home = number - 1, claims.home[agent]
    to = options.aim[now[agent], option, 1]
    if claims.cells[to, 1] != NOBODY:
        return False
    ahead = claims.cells[to, 0]
    if to != home and ahead != NOBODY and claims.goes[ahead] != UNDECIDED:
        if claims.goes[ahead] == home:
            return False  # swap
        if not allow_rotation and _closes_ring(claims, agent, ahead):
            return False
    if options.has_sweeps:
        if claims.crossed[to] != NOBODY:
            return False
        move = options.sweep[now[agent], option]
        if move >= 0:
            for k in range(options.beside_ptr[move], options.beside_ptr[move + 1]):
                cell = options.beside[k]
                if claims.cells[cell, 0] != NOBODY or claims.cells[cell, 1] != NOBODY:
                    return False
                if claims.crossed[cell] != NOBODY:
                    return False
    return True


@inlined
def push(
    options: Options,
    claims: Claims,
    keys: npt.NDArray[np.generic],
    used_up: float,
    now: IntArray,
    after: IntArray,
    depth: Int,
    allow_rotation: bool,
) -> tuple[Int, Int]:  # pragma: no cover - compiled
    """Go on with the chain of agents that push each other until one more is pushed, or it has ended.

    The recursion of the paper is the explicit stack `claims.stack`: to call it for an agent is to put that agent on
    top, and it returns valid where the whole chain settles, invalid where the agent on top stays.

    Args:
        options: What agents can aim at.
        claims: What is decided so far.
        keys: The lower, the sooner an option is tried; by agent and number, 0 = to wait; shape (n, widest + 1).
            Options that have been tried get `used_up`.
        used_up: More than any key; on the chain every agent but a pushed one that is new has been ranked.
        now: State of each agent, shape (n,).
        after: Receives the states of those who decide, shape (n,).
        depth: Place on the chain of the agent that is next.
        allow_rotation: Whether a closed ring of followers is legal.

    Returns:
        `PUSHED`, `SETTLED` or `STUCK`; and the place of the last agent of the chain, -1 = all stay.

    Source: Okumura, Machida, Défago, Tamura, "Priority Inheritance with Backtracking for Iterative Multi-agent Path
    Finding", Artificial Intelligence 310, 2022, algorithm 1, https://doi.org/10.1016/j.artint.2022.103752.
    """
    while depth >= 0:
        agent = claims.stack[depth]
        # The candidates in their order: stay, and each neighbour.
        number, least = 0, keys[agent, 0]
        for k in range(1, keys.shape[1]):
            if keys[agent, k] < least:
                number, least = k, keys[agent, k]

        if least == used_up:  # no candidate is left: stay, return invalid; whoever pushed takes its step back
            stuck = depth == 0 and claims.cells[claims.home[agent], 1] != NOBODY
            stay(claims, now, after, agent)
            if stuck:
                return STUCK, 0
            depth -= 1
            if depth >= 0:
                _take_back(options, claims, now, claims.stack[depth])
            continue

        keys[agent, number] = used_up
        if number == 0:
            if claims.cells[claims.home[agent], 1] == NOBODY:
                stay(claims, now, after, agent)
                return SETTLED, depth
            continue
        # Vertex conflicts and swaps, as in the paper; sweeps and rings are additions.
        if not is_allowed(options, claims, now, agent, number, allow_rotation):
            continue
        go(options, claims, now, after, agent, number)

        # Priority inheritance: whoever stands there and is undecided must choose now. Otherwise return valid.
        ahead = claims.cells[claims.goes[agent], 0]
        if ahead == NOBODY or claims.goes[ahead] != UNDECIDED:  # itself, where it only turns
            return SETTLED, depth
        depth += 1
        claims.stack[depth] = ahead
        return PUSHED, depth
    return SETTLED, -1


@kernel
def _take_back(options: Options, claims: Claims, now: IntArray, agent: Int) -> None:  # pragma: no cover - compiled
    """Make an agent undecided again; the cell that it aimed at is that of the agent who stays there by now."""
    claims.goes[agent] = UNDECIDED
    if options.has_sweeps:
        _uncross(options, claims, now, agent)


@kernel
def _uncross(options: Options, claims: Claims, now: IntArray, agent: Int) -> None:  # pragma: no cover - compiled
    """Give back the cells that an agent's option sweeps over."""
    if claims.number[agent] > 0:
        move = options.sweep[now[agent], claims.number[agent] - 1]
        if move >= 0:
            for k in range(options.beside_ptr[move], options.beside_ptr[move + 1]):
                claims.crossed[options.beside[k]] = NOBODY


@kernel
def _closes_ring(claims: Claims, agent: Int, ahead: Int) -> bool:  # pragma: no cover - compiled
    """Whether following `ahead`, who follows somebody in turn, ends at `agent` again."""
    while claims.goes[ahead] != UNDECIDED:
        beyond = claims.cells[claims.goes[ahead], 0]
        if beyond == agent:
            return True
        if beyond < 0 or beyond == ahead:
            return False
        ahead = beyond
    return False
