"""Network: policy and value of one type of agents."""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import cast

import torch
from gymnasium.spaces import Discrete
from torch import Tensor, nn

from fleet.training.batch import AgentType
from fleet.training.ppo.attention import Attention, linear
from fleet.training.settings import PpoConfig

_NEVER = -1e9
"""Score of an illegal action."""


class Network(nn.Module):
    """Two networks, for the policy and for the value, shared by all agents of a type.

    Continuous actions are normally distributed about the policy's output, with a spread that does not depend on the
    observation; discrete ones have its outputs as scores. Weights are orthogonal, those of the policy's last layer
    small, so that it begins without preferences.

    Where actions choose among alike things (`RowLayout.chosen`), one perceptron scores each of them from what is known
    of it and of all else, so that what is learned of one holds for all; action 0 is a thing of zeros. Without attention
    it knows nothing of the others.

    A central critic is a perceptron that is told the state of the environment beside what the agent sees.

    Args:
        kind: The agents.
        config: Kind and widths of the networks, spread at the start.
        n_state: Numbers of the state that a central critic is told.
        generator: Source of the weights.

    Source: central critic: C. Yu et al., "The Surprising Effectiveness of PPO in Cooperative Multi-Agent Games",
    arXiv:2103.01955, 2022, with the agent's own numbers beside the state.
    """

    def __init__(self, kind: AgentType, config: PpoConfig, n_state: int, generator: torch.Generator) -> None:
        super().__init__()
        space = kind.action
        self.discrete = isinstance(space, Discrete)
        n = int(space.n) if isinstance(space, Discrete) else int(space.shape[0])
        attends = config.network == "attention" and bool(kind.layout.groups)
        self.actor: nn.Module
        if kind.layout.chosen is not None:
            self.actor = _Scorer(kind, config, attends, generator)
        elif attends:
            self.actor = _Looker(kind, config, n, 0.01, generator)
        else:
            self.actor = perceptron((kind.n_observed, *config.hidden, n), 0.01, generator)
        self.critic: nn.Module
        if config.critic == "own" and attends:
            self.critic = _Looker(kind, config, 1, 1.0, generator)
        else:
            self.critic = perceptron((kind.n_observed + n_state, *config.hidden, 1), 1.0, generator)
        if not self.discrete:
            self.log_std = nn.Parameter(torch.full((n,), config.log_std))

    def scores(self, rows: Tensor, mask: Tensor | None) -> Tensor:
        """Logarithms of the shares of discrete actions, or the middle of continuous ones, shape (b, n).

        Args:
            rows: Observations, shape (b, n_observed).
            mask: Legal actions, shape (b, n), or None.
        """
        out: Tensor = self.actor(rows)
        if not self.discrete:
            return out
        return torch.log_softmax(out if mask is None else out.masked_fill(~mask, _NEVER), dim=1)

    def value(self, rows: Tensor, state: Tensor | None = None) -> Tensor:
        """Values of observations (b, n_observed) and states (b, n_state), shape (b,)."""
        found: Tensor = self.critic(rows if state is None else torch.cat((rows, state), dim=1))
        return found.squeeze(-1)

    @torch.no_grad()
    def forget(self, numbers: Sequence[int]) -> None:
        """Take their weight from some of the numbers observed, where a perceptron is told these as they are."""
        for part in (self.actor, self.critic):
            if isinstance(part, nn.Sequential):
                cast(nn.Linear, part[0]).weight.index_fill_(1, torch.tensor(numbers, dtype=torch.long), 0.0)

    def draw(self, scores: Tensor, generator: torch.Generator) -> tuple[Tensor, Tensor]:
        """Draw actions.

        Args:
            scores: Of `scores`.
            generator: Source of chance.

        Returns:
            Actions, shape (b, n_entries) or (b,), and the logarithms of their probabilities, shape (b,).
        """
        if self.discrete:
            actions = torch.multinomial(scores.exp(), 1, generator=generator)
            return actions.squeeze(1), scores.gather(1, actions).squeeze(1)
        noise = torch.randn(scores.shape, generator=generator)
        return scores + noise * self.log_std.exp(), self._log_density(noise)

    def judge(self, scores: Tensor, actions: Tensor) -> tuple[Tensor, Tensor]:
        """Logarithms of the probabilities of actions, and the entropies of what they were drawn from, shape (b,)."""
        if self.discrete:
            entropies = -(scores.exp() * scores).sum(dim=1)
            return scores.gather(1, actions[:, None]).squeeze(1), entropies
        entropy = (self.log_std + 0.5 * math.log(2.0 * math.pi * math.e)).sum().expand(len(scores))
        return self._log_density((actions - scores) / self.log_std.exp()), entropy

    def imitation(self, scores: Tensor, actions: Tensor) -> Tensor:
        """How far each policy is from doing an action, shape (b,): cross entropy, or half the squared distance."""
        if self.discrete:
            return -scores.gather(1, actions[:, None]).squeeze(1)
        return 0.5 * ((actions - scores) ** 2).sum(dim=1)

    def cross_entropy(self, scores: Tensor, shares: Tensor) -> Tensor:
        """Cross entropy of shares of actions (b, n_actions) and this policy, shape (b,); illegal ones have none."""
        return -(shares * scores).sum(dim=1)

    def divergence(self, scores: Tensor, known: Tensor, known_log_std: Tensor | None) -> Tensor:
        """Kullback-Leibler divergence of this policy from a known one, that one first, shape (b,).

        Args:
            scores: Of this network.
            known: Of the other on the same observations.
            known_log_std: Its spread, of continuous actions.
        """
        if known_log_std is None:
            return (known.exp() * (known - scores)).sum(dim=1)
        spread = self.log_std - known_log_std
        square = (2.0 * known_log_std).exp() + (known - scores) ** 2
        return (spread + 0.5 * square / (2.0 * self.log_std).exp() - 0.5).sum(dim=1)

    def _log_density(self, noise: Tensor) -> Tensor:
        return (-0.5 * noise**2 - self.log_std - 0.5 * math.log(2.0 * math.pi)).sum(dim=1)


class _Looker(nn.Module):
    """A perceptron on what an agent knows after it has looked around."""

    def __init__(
        self, kind: AgentType, config: PpoConfig, n_out: int, last_gain: float, generator: torch.Generator
    ) -> None:
        super().__init__()
        self.attention = Attention(kind, config.hidden[0], generator)
        self.head = perceptron((*config.hidden, n_out), last_gain, generator)

    def forward(self, rows: Tensor) -> Tensor:
        found: Tensor = self.head(self.attention(rows)[0])
        return found


class _Scorer(nn.Module):
    """A score for each thing that actions choose from, shape (b, n_actions)."""

    def __init__(self, kind: AgentType, config: PpoConfig, attends: bool, generator: torch.Generator) -> None:
        super().__init__()
        assert kind.layout.chosen is not None
        assert isinstance(kind.action, Discrete)
        group = kind.layout.groups[kind.layout.chosen]
        self._first, self._n_each, self._n_things = group.first, group.n_each, group.n_things or 0
        self._none = int(kind.action.n) > self._n_things
        self.attention = Attention(kind, config.hidden[0], generator) if attends else None
        if attends:
            self.head = perceptron((2 * config.hidden[0], *config.hidden[1:], 1), 0.01, generator)
        else:
            n_rest = kind.n_observed - self._n_things * self._n_each
            self.head = perceptron((n_rest + self._n_each, *config.hidden, 1), 0.01, generator)

    def forward(self, rows: Tensor) -> Tensor:
        if self.attention is None:
            end = self._first + self._n_things * self._n_each
            each = rows[:, self._first : end].reshape(len(rows), self._n_things, self._n_each)
            rest = torch.cat((rows[:, : self._first], rows[:, end:]), dim=1)
        else:
            rest, each = self.attention(rows)
        if self._none:
            each = torch.cat((torch.zeros_like(each[:, :1]), each), dim=1)
        rest = rest[:, None].expand(-1, each.shape[1], -1)
        found: Tensor = self.head(torch.cat((rest, each), dim=2))
        return found.squeeze(2)


def perceptron(widths: tuple[int, ...], last_gain: float, generator: torch.Generator) -> nn.Sequential:
    """Layers with tanh between them.

    Args:
        widths: Of the input, the hidden layers and the output.
        last_gain: Of the weights of the last layer.
        generator: Source of the weights.
    """
    layers: list[nn.Module] = []
    for k, (before, after) in enumerate(pairwise(widths)):
        last = k == len(widths) - 2
        layer = linear(before, after, last_gain if last else math.sqrt(2.0), generator)
        layers += [layer] if last else [layer, nn.Tanh()]
    return nn.Sequential(*layers)
