"""Attention: an agent, and the things that it may choose, look at all things around it before anything is decided."""

from __future__ import annotations

import math

import torch
from torch import Tensor, nn

from fleet.training.batch import AgentType
from fleet.training.settings import N_HEADS


class Attention(nn.Module):
    """One block of attention over the groups of a layout.

    Own numbers become one token, each thing another. The agent's token, and those of the group that actions choose
    from, ask; all tokens answer but those of things that are not there. The order of things of a group does not matter.

    Args:
        kind: The agents; their layout has a group or more.
        width: Of a token.
        generator: Source of the weights.

    Source: A. Vaswani et al., "Attention Is All You Need", arXiv:1706.03762, 2017, one layer without its perceptron.
    """

    own: Tensor
    """Columns of what an agent knows of itself."""

    def __init__(self, kind: AgentType, width: int, generator: torch.Generator) -> None:
        super().__init__()
        self._groups, self._chosen = kind.layout.groups, kind.layout.chosen
        own = kind.layout.own(kind.n_observed)
        self.register_buffer("own", torch.tensor(own, dtype=torch.long), persistent=False)
        self.embed_own = linear(len(own), width, math.sqrt(2.0), generator)
        self.embed = nn.ModuleList(linear(one.n_each, width, math.sqrt(2.0), generator) for one in self._groups)
        self.query, self.key, self.answer, self.out = (linear(width, width, 1.0, generator) for _ in range(4))

    def forward(self, rows: Tensor) -> tuple[Tensor, Tensor | None]:
        """Look around.

        Args:
            rows: Observations, shape (b, n_observed).

        Returns:
            What the agent knows then, shape (b, width), and what is known of each thing it may choose, shape
            (b, n_things, width), None where actions choose nothing.
        """
        n = len(rows)
        tokens = [torch.tanh(self.embed_own(rows[:, self.own]))[:, None]]
        there = [torch.ones((n, 1), dtype=torch.bool, device=rows.device)]
        for group, embed in zip(self._groups, self.embed, strict=True):
            n_things = group.n_things or 0
            things = rows[:, group.first : group.first + n_things * group.n_each].reshape(n, n_things, group.n_each)
            tokens.append(torch.tanh(embed(things)))
            there.append((things != 0.0).any(dim=2) if group.present is None else things[:, :, group.present] > 0.0)
        asking = tokens[0] if self._chosen is None else torch.cat((tokens[0], tokens[1 + self._chosen]), dim=1)
        answering = torch.cat(tokens, dim=1)
        found = nn.functional.scaled_dot_product_attention(
            _heads(self.query(asking)),
            _heads(self.key(answering)),
            _heads(self.answer(answering)),
            attn_mask=torch.cat(there, dim=1)[:, None, None],
        )
        known = torch.tanh(asking + self.out(found.transpose(1, 2).reshape(asking.shape)))
        return known[:, 0], None if self._chosen is None else known[:, 1:]


def linear(n_in: int, n_out: int, gain: float, generator: torch.Generator) -> nn.Linear:
    """A layer with orthogonal weights.

    Source: A. Saxe, J. McClelland, S. Ganguli, "Exact solutions to the nonlinear dynamics of learning in deep linear
    neural networks", ICLR 2014.
    """
    layer = nn.Linear(n_in, n_out)
    nn.init.orthogonal_(layer.weight, gain, generator=generator)
    nn.init.zeros_(layer.bias)
    return layer


def _heads(tokens: Tensor) -> Tensor:
    """Tokens (b, n, width) as (b, n_heads, n, width / n_heads)."""
    return tokens.unflatten(2, (N_HEADS, -1)).transpose(1, 2)
