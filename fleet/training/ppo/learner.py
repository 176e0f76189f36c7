"""Learner: what one type of agents has learned, and how it learns from a rollout."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
import torch
from gymnasium.spaces import Box
from torch import Tensor

from fleet.training.advantages import advantages
from fleet.training.batch import AgentType, TypeView
from fleet.training.normalizer import Normalizer
from fleet.training.ppo.network import Network
from fleet.training.settings import PpoConfig

Floats = npt.NDArray[np.float32]


@dataclass(kw_only=True)
class Rollout:
    """Steps of all agents of a type, T of them in n columns."""

    rows: Floats
    """Normalised observations, shape (T, n, n_observed)."""
    mask: npt.NDArray[np.bool_] | None
    """Legal actions, shape (T, n, n_actions)."""
    actions: npt.NDArray[Any]
    """As drawn, shape (T, n, n_entries) or (T, n)."""
    log_shares: Floats
    values: Floats
    after: Floats
    """Value of the state a step led to, zero where the episode terminated."""
    rewards: Floats
    ended: npt.NDArray[np.bool_]


class Learner:
    """Network, optimiser and normalisers of one type of agents.

    Args:
        kind: The agents.
        config: Settings.
        generator: Source of the first weights.
    """

    def __init__(self, kind: AgentType, config: PpoConfig, generator: torch.Generator) -> None:
        self.kind = kind
        self._config = config
        self.network = Network(kind, config.hidden, config.log_std, generator)
        self.optimizer = torch.optim.Adam(self.network.parameters(), lr=config.learning_rate, eps=1e-5)
        self.seen = Normalizer(kind.n_observed)
        self.earned = Normalizer(1)
        """Discounted sums of rewards: rewards are divided by their spread."""

    @torch.no_grad()
    def choose(
        self, view: TypeView, generator: torch.Generator
    ) -> tuple[Floats, npt.NDArray[Any], npt.NDArray[np.float32], npt.NDArray[np.float32]]:
        """Draw an action for every row of a view.

        Returns:
            Normalised observations, actions as drawn, logarithms of their probabilities, values.
        """
        rows = self.seen.apply(view.rows)
        seen = torch.from_numpy(rows)
        actions, log_shares = self.network.sample(seen, _tensor(view.mask), generator)
        return rows, actions.numpy(), log_shares.numpy(), self.network.value(seen).numpy()

    @torch.no_grad()
    def values(self, view: TypeView) -> Floats:
        """Values of every row of a view."""
        found: Floats = self.network.value(torch.from_numpy(self.seen.apply(view.rows))).numpy()
        return found

    @torch.no_grad()
    def best(self, view: TypeView) -> npt.NDArray[Any]:
        """The likeliest actions, as the environment takes them."""
        rows = torch.from_numpy(self.seen.apply(view.rows))
        return self.legal(self.network.best(rows, _tensor(view.mask)).numpy())

    def legal(self, actions: npt.NDArray[Any]) -> npt.NDArray[Any]:
        """Actions as the environment takes them: continuous ones are cut to [-1, 1] and spread over their range."""
        space = self.kind.action
        if not isinstance(space, Box):
            return actions
        share = (np.clip(actions, -1.0, 1.0) + 1.0) / 2.0
        scaled: npt.NDArray[Any] = (space.low + share * (space.high - space.low)).astype(np.float32)
        return scaled

    def learn(self, rollout: Rollout, rate: float, generator: torch.Generator) -> dict[str, float]:
        """Improve policy and value by a rollout.

        Args:
            rollout: Made by this learner as it is.
            rate: Learning rate.
            generator: Source of the order of samples.

        Returns:
            Mean losses, entropy, approximate divergence from the old policy, and share of clipped samples.
        """
        config = self._config
        gained = advantages(
            rollout.rewards, rollout.values, rollout.after, rollout.ended, discount=config.discount, gae=config.gae
        )
        rows, actions = _flat(rollout.rows), _flat(rollout.actions)
        mask = None if rollout.mask is None else _flat(rollout.mask)
        # An agent without a choice teaches the value, not the policy.
        chose = torch.ones(len(rows), dtype=torch.bool) if mask is None else mask.sum(dim=1) > 1
        old, gain, targets = _flat(rollout.log_shares), _flat(gained), _flat(gained + rollout.values)
        for group in self.optimizer.param_groups:
            group["lr"] = rate
        sums = dict.fromkeys(("value_loss", "policy_loss", "entropy", "divergence", "clipped"), 0.0)
        n_steps = 0
        for _ in range(config.epochs_n):
            order = torch.randperm(len(rows), generator=generator)
            for picked in order.split(config.minibatch_n):
                found = self._descend(
                    rows[picked],
                    None if mask is None else mask[picked],
                    actions[picked],
                    old[picked],
                    gain[picked],
                    targets[picked],
                    chose[picked],
                )
                n_steps += 1
                for name, value in zip(sums, found, strict=True):
                    sums[name] += value
        return {name: total / n_steps for name, total in sums.items()}

    def state(self) -> dict[str, Any]:
        """All there is to remember."""
        return {
            "network": self.network.state_dict(),
            "optimizer": self.optimizer.state_dict(),
            "seen": self.seen.state(),
            "earned": self.earned.state(),
        }

    def recall(self, state: dict[str, Any]) -> None:
        """Return to a `state`."""
        self.network.load_state_dict(state["network"])
        self.optimizer.load_state_dict(state["optimizer"])
        self.seen.recall(state["seen"])
        self.earned.recall(state["earned"])

    def _descend(
        self,
        rows: Tensor,
        mask: Tensor | None,
        actions: Tensor,
        old: Tensor,
        gain: Tensor,
        targets: Tensor,
        chose: Tensor,
    ) -> tuple[float, ...]:
        """One gradient step on the clipped objective, eq. (7) and (9) of the paper."""
        config = self._config
        loss = config.value * (value_loss := 0.5 * ((self.network.value(rows) - targets) ** 2).mean())
        told = [float(value_loss.detach()), 0.0, 0.0, 0.0, 0.0]
        if chose.any():
            old, gain = old[chose], gain[chose]
            gain = (gain - gain.mean()) / (gain.std(correction=0) + 1e-8)
            log_shares, entropies = self.network.judge(
                rows[chose], None if mask is None else mask[chose], actions[chose]
            )
            change = log_shares - old
            ratio = change.exp()
            clipped = ratio.clamp(1.0 - config.clip, 1.0 + config.clip)
            policy_loss = -torch.minimum(ratio * gain, clipped * gain).mean()
            entropy = entropies.mean()
            loss = loss + policy_loss - config.entropy * entropy
            with torch.no_grad():
                divergence = (ratio - 1.0 - change).mean()  # J. Schulman, "Approximating KL Divergence", 2020: k3
                outside = ((ratio - 1.0).abs() > config.clip).float().mean()
            told[1:] = [float(x.detach()) for x in (policy_loss, entropy, divergence, outside)]
        self.optimizer.zero_grad()
        loss.backward()
        torch.nn.utils.clip_grad_norm_(self.network.parameters(), config.max_grad_norm)
        self.optimizer.step()
        return tuple(told)


def _tensor(mask: npt.NDArray[np.bool_] | None) -> Tensor | None:
    return None if mask is None else torch.from_numpy(mask)


def _flat(steps: npt.NDArray[Any]) -> Tensor:
    """Steps (T, n, ...) as samples (T * n, ...)."""
    return torch.from_numpy(steps.reshape(-1, *steps.shape[2:]))
