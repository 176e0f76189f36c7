"""Network: policy and value of one type of agents."""

from __future__ import annotations

import math
from itertools import pairwise

import torch
from gymnasium.spaces import Discrete
from torch import Tensor, nn

from fleet.training.batch import AgentType

_NEVER = -1e9
"""Score of an illegal action."""


class Network(nn.Module):
    """Two perceptrons, for the policy and for the value, shared by all agents of a type.

    Continuous actions are normally distributed about the policy's output, with a spread that does not depend on the
    observation; discrete ones have its outputs as scores. Weights are orthogonal, those of the policy's last layer
    small, so that it begins without preferences.

    Where actions choose among alike things (`AgentType.choice`), one perceptron scores each of them from what is known
    of it and of all else, so that what is learned of one holds for all; a thing that is not there stands for action 0.

    Args:
        kind: The agents.
        hidden: Widths of the hidden layers.
        log_std: Logarithm of the spread at the start.
        generator: Source of the weights.
    """

    def __init__(self, kind: AgentType, hidden: tuple[int, ...], log_std: float, generator: torch.Generator) -> None:
        super().__init__()
        space = kind.action
        self.discrete = isinstance(space, Discrete)
        n = int(space.n) if isinstance(space, Discrete) else int(space.shape[0])
        self._choice, self._n = kind.choice, n
        if kind.choice is None:
            self.actor = _perceptron(kind.n_observed, hidden, n, 0.01, generator)
        else:
            n_in = kind.n_observed - (n - 2) * kind.choice.n_each
            self.actor = _perceptron(n_in, hidden, 1, 0.01, generator)
        self.critic = _perceptron(kind.n_observed, hidden, 1, 1.0, generator)
        if not self.discrete:
            self.log_std = nn.Parameter(torch.full((n,), log_std))

    def scores(self, rows: Tensor) -> Tensor:
        """Scores of discrete actions, or the middle of continuous ones, shape (b, n)."""
        choice = self._choice
        if choice is None:
            return self.actor(rows)
        end = choice.n_own + (self._n - 1) * choice.n_each
        each = rows[:, choice.n_own : end].reshape(len(rows), self._n - 1, choice.n_each)
        each = torch.cat((torch.zeros_like(each[:, :1]), each), dim=1)
        rest = torch.cat((rows[:, : choice.n_own], rows[:, end:]), dim=1)[:, None].expand(-1, self._n, -1)
        return self.actor(torch.cat((rest, each), dim=2)).squeeze(2)

    def value(self, rows: Tensor) -> Tensor:
        """Values of observations (b, n), shape (b,)."""
        return self.critic(rows).squeeze(-1)

    def sample(self, rows: Tensor, mask: Tensor | None, generator: torch.Generator) -> tuple[Tensor, Tensor]:
        """Draw actions.

        Args:
            rows: Observations, shape (b, n).
            mask: Legal actions, shape (b, n_actions), or None.
            generator: Source of chance.

        Returns:
            Actions, shape (b, n_entries) or (b,), and the logarithms of their probabilities, shape (b,).
        """
        out = self.scores(rows)
        if self.discrete:
            shares = _log_shares(out, mask)
            actions = torch.multinomial(shares.exp(), 1, generator=generator).squeeze(1)
            return actions, shares.gather(1, actions[:, None]).squeeze(1)
        noise = torch.randn(out.shape, generator=generator)
        return out + noise * self.log_std.exp(), self._log_density(noise)

    def best(self, rows: Tensor, mask: Tensor | None) -> Tensor:
        """Likeliest actions, shape (b, n_entries) or (b,)."""
        out = self.scores(rows)
        return _log_shares(out, mask).argmax(dim=1) if self.discrete else out

    def judge(self, rows: Tensor, mask: Tensor | None, actions: Tensor) -> tuple[Tensor, Tensor]:
        """Logarithms of the probabilities of actions, and the entropies of what they were drawn from, shape (b,)."""
        out = self.scores(rows)
        if self.discrete:
            shares = _log_shares(out, mask)
            return shares.gather(1, actions[:, None]).squeeze(1), -(shares.exp() * shares).sum(dim=1)
        entropy = (self.log_std + 0.5 * math.log(2.0 * math.pi * math.e)).sum().expand(len(rows))
        return self._log_density((actions - out) / self.log_std.exp()), entropy

    def _log_density(self, noise: Tensor) -> Tensor:
        return (-0.5 * noise**2 - self.log_std - 0.5 * math.log(2.0 * math.pi)).sum(dim=1)


def _log_shares(scores: Tensor, mask: Tensor | None) -> Tensor:
    return torch.log_softmax(scores if mask is None else scores.masked_fill(~mask, _NEVER), dim=1)


def _perceptron(
    n_in: int, hidden: tuple[int, ...], n_out: int, last_gain: float, generator: torch.Generator
) -> nn.Sequential:
    layers: list[nn.Module] = []
    widths = (n_in, *hidden, n_out)
    for k, (before, after) in enumerate(pairwise(widths)):
        layer = nn.Linear(before, after)
        last = k == len(widths) - 2
        nn.init.orthogonal_(layer.weight, last_gain if last else math.sqrt(2.0), generator=generator)
        nn.init.zeros_(layer.bias)
        layers += [layer] if last else [layer, nn.Tanh()]
    return nn.Sequential(*layers)
