"""Learner: what one type of agents has learned, and how it learns from a rollout."""

from __future__ import annotations

import copy
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
import torch
from gymnasium.spaces import Box
from torch import Tensor

from fleet.training.batch import AgentType, TypeView, masks_of
from fleet.training.demonstrations import Demonstration
from fleet.training.normalizer import Normalizer
from fleet.training.ppo.advantages import advantages
from fleet.training.ppo.network import Network
from fleet.training.settings import PpoConfig

Floats = npt.NDArray[np.float32]
LOSSES = ("value_loss", "policy_loss", "entropy", "divergence", "clipped")


@dataclass(kw_only=True)
class Rollout:
    """Steps of all agents of a type, T of them in n columns."""

    rows: Floats
    """Normalised observations, shape (T, n, n_observed)."""
    mask: npt.NDArray[np.bool_] | None
    """Legal actions, shape (T, n, n_actions)."""
    state: Floats | None
    """Normalised states, shape (T, n, n_state)."""
    active: npt.NDArray[np.bool_]
    """Agents that there were, shape (T, n)."""
    actions: npt.NDArray[Any]
    """As drawn, or those of a teacher, shape (T, n, n_entries) or (T, n)."""
    worths: Floats | None = None
    """What a teacher thinks of each action, shape (T, n, n_actions)."""
    log_shares: Floats
    values: Floats
    after: Floats
    """Value of the state a step led to, zero where the episode terminated."""
    rewards: Floats
    ended: npt.NDArray[np.bool_]
    seen: Floats
    """Observations as they were, one line for each agent that there was: what the normaliser learns from."""
    told: Floats | None
    """States, likewise."""


@dataclass(frozen=True, kw_only=True)
class _Samples:
    """Samples of a rollout in one line, b of them."""

    rows: Tensor
    mask: Tensor | None
    state: Tensor | None
    actions: Tensor
    targets: Tensor
    """Of the value."""
    gain: Tensor
    log_shares: Tensor
    chose: Tensor
    """Whether the agent had a choice, and so teaches the policy."""
    anchored: Tensor | None
    """Scores of the cloned policy."""

    def pick(self, index: Tensor) -> _Samples:
        """Some of them, those that had a choice first."""
        chose = self.chose[index]
        if not chose.all():
            index = torch.cat((index[chose], index[~chose]))
        return self._each(lambda one: one.index_select(0, index))

    def choosing(self) -> _Samples:
        """Those that had a choice, of what was picked; a view, not a copy."""
        n = int(self.chose.sum())
        return self._each(lambda one: one[:n])

    def _each(self, part: Callable[[Tensor], Tensor]) -> _Samples:
        parts: dict[str, Any] = {name: None if one is None else part(one) for name, one in vars(self).items()}
        return _Samples(**parts)


class _Shown(NamedTuple):
    """What a teacher did where there was a choice, n samples."""

    rows: Tensor
    """Observations as they were, shape (n, n_observed)."""
    mask: Tensor | None
    actions: Tensor
    """As the network has them."""
    shares: Tensor | None = None
    """How often to do each action instead, shape (n, n_actions)."""

    def then(self, later: _Shown) -> _Shown:
        """These samples and later ones."""
        return _Shown(
            rows=torch.cat((self.rows, later.rows)),
            mask=None if self.mask is None or later.mask is None else torch.cat((self.mask, later.mask)),
            actions=torch.cat((self.actions, later.actions)),
            shares=None if self.shares is None or later.shares is None else torch.cat((self.shares, later.shares)),
        )


class Learner:
    """Network, optimiser and normalisers of one type of agents.

    Args:
        kind: The agents.
        config: Settings.
        n_state: Numbers of the state that a central critic is told; 0 without one.
        generator: Source of the first weights.
    """

    def __init__(self, kind: AgentType, config: PpoConfig, n_state: int, generator: torch.Generator) -> None:
        self.kind = kind
        self._config = config
        self.network = Network(kind, config, n_state, generator)
        self.optimizer = torch.optim.Adam(self.network.parameters(), lr=config.learning_rate, eps=1e-5, fused=True)
        # Things that are compared have to be told in the same units.
        own = kind.layout.own(kind.n_observed) if kind.layout.chosen is None else []
        self.seen = Normalizer(
            kind.n_observed, fixed=sorted(set(range(kind.n_observed)) - set(own)), unseen=kind.layout.unseen
        )
        self.told = Normalizer(n_state)
        """States."""
        self.earned = Normalizer(1)
        """Discounted sums of rewards: rewards are divided by their spread."""
        self.anchor: Network | None = None
        """The policy that was cloned."""
        self._shown: _Shown | None = None

    @torch.no_grad()
    def choose(
        self, view: TypeView, rows: Floats, generator: torch.Generator
    ) -> tuple[npt.NDArray[Any], npt.NDArray[np.float32]]:
        """Draw an action for every row of a view.

        Args:
            view: What agents see.
            rows: Receives their normalised observations, shape (n, n_observed).
            generator: Source of chance.

        Returns:
            Actions as drawn, logarithms of their probabilities.
        """
        self.seen.apply(view.rows, rows)
        scores = self.network.scores(torch.from_numpy(rows), _tensor(view.mask))
        actions, log_shares = self.network.draw(scores, generator)
        return actions.numpy(), log_shares.numpy()

    @torch.no_grad()
    def values(self, rows: Floats, state: Floats | None) -> Floats:
        """Values of normalised observations (b, n_observed) and states (b, n_state), shape (b,)."""
        found: Floats = self.network.value(torch.from_numpy(rows), _tensor(state)).numpy()
        return found

    @torch.no_grad()
    def scores(self, view: TypeView) -> Floats:
        """Logarithms of the shares of discrete actions, or the middle of continuous ones, shape (n, n_entries)."""
        rows = torch.from_numpy(self.seen.apply(view.rows))
        found: Floats = self.network.scores(rows, _tensor(view.mask)).numpy()
        return found

    @torch.no_grad()
    def act(self, view: TypeView, generator: torch.Generator | None) -> npt.NDArray[Any]:
        """Actions as the environment takes them: drawn, or without a source of chance the likeliest ones."""
        scores = torch.from_numpy(self.scores(view))
        if generator is not None:
            actions = self.network.draw(scores, generator)[0]
        else:
            actions = scores.argmax(dim=1) if self.network.discrete else scores
        return self.legal(actions.numpy())

    def legal(self, actions: npt.NDArray[Any]) -> npt.NDArray[Any]:
        """Actions as the environment takes them: continuous ones are cut to [-1, 1] and spread over their range."""
        space = self.kind.action
        if not isinstance(space, Box):
            return actions
        share = (np.clip(actions, -1.0, 1.0) + 1.0) / 2.0
        scaled: npt.NDArray[Any] = (space.low + share * (space.high - space.low)).astype(np.float32)
        return scaled

    def plain(self, actions: npt.NDArray[Any]) -> npt.NDArray[Any]:
        """The opposite of `legal`: actions of the environment as the network has them."""
        space = self.kind.action
        if not isinstance(space, Box):
            return actions.astype(np.int64)
        share = (actions - space.low) / (space.high - space.low)
        return (np.clip(share, 0.0, 1.0) * 2.0 - 1.0).astype(np.float32)

    def learn(self, rollout: Rollout, rate: float, anchor: float, generator: torch.Generator) -> dict[str, float]:
        """Improve policy and value by a rollout.

        Args:
            rollout: Made by this learner as it is.
            rate: Learning rate.
            anchor: Weight of the divergence from the cloned policy, if there is one.
            generator: Source of the order of samples.

        Returns:
            Mean losses, entropy, approximate divergence from the old policy, and share of clipped samples.
        """
        config = self._config
        samples = self._samples(rollout, anchor > 0.0)
        sums = dict.fromkeys(LOSSES, 0.0)
        n_steps = 0
        for _ in range(config.epochs_n):
            before, since = sums["divergence"], n_steps
            for picked in self._minibatches(len(samples.rows), generator):
                found = self._descend(samples.pick(picked), rate, anchor)
                n_steps += 1
                for name, value in zip(sums, found, strict=True):
                    sums[name] += value
            if config.divergence and (sums["divergence"] - before) / (n_steps - since) > config.divergence:
                break
        self._notice(rollout.seen, rollout.told)
        return {name: total / n_steps for name, total in sums.items()}

    def clone(self, rollout: Rollout, rate: float, generator: torch.Generator) -> dict[str, float]:
        """Imitate the actions of a rollout, and learn its values.

        Returns:
            Mean losses, as of `learn`; the policy's is how far it is from the teacher.
        """
        samples = self._samples(rollout, False)
        sums, n_steps = np.zeros(2), 0
        for _ in range(self._config.epochs_n):
            for picked in self._minibatches(len(samples.rows), generator):
                one = samples.pick(picked)
                value_loss = 0.5 * ((self.network.value(one.rows, one.state) - one.targets) ** 2).mean()
                policy_loss = torch.zeros(())
                if not self._config.clone_all:
                    policy_loss = self._imitation(one.rows, one.mask, one.actions, one.chose)
                self._step(self._config.value * value_loss + policy_loss, rate)
                sums += (value_loss.item(), policy_loss.item())
                n_steps += 1
        self._notice(rollout.seen, rollout.told)
        value, policy = (sums / n_steps).tolist()
        if self._config.clone_all:
            shown = self._show(rollout)
            self._shown = shown if self._shown is None else self._shown.then(shown)
            policy = self._imitate(self._shown, self._config.epochs_n, rate, generator)
        return {**dict.fromkeys(LOSSES, float("nan")), "value_loss": value, "policy_loss": policy}

    def clone_samples(self, told: Demonstration, n_epochs: int, rate: float, generator: torch.Generator) -> None:
        """Imitate what a teacher did.

        Args:
            told: What it saw and did.
            n_epochs: Times that each sample is used.
            rate: Learning rate.
            generator: Source of the order of samples.
        """
        self._notice(told.rows, None)
        mask = None if told.mask is None else torch.from_numpy(masks_of(told.mask, self.kind))
        actions = torch.from_numpy(self.plain(told.actions))
        shown = _Shown(torch.from_numpy(told.rows), mask, actions, self._shares(told.worths, mask))
        self._imitate(shown, n_epochs, rate, generator)

    @property
    def is_finite(self) -> bool:
        """Whether all weights are finite numbers."""
        return all(bool(torch.isfinite(weights).all()) for weights in self.network.parameters())

    def forget_teacher(self) -> None:
        """Forget all that a teacher has said, once it is no longer asked."""
        self._shown = None

    def keep_anchor(self) -> None:
        """Remember the policy as it is: what was cloned."""
        self.anchor = copy.deepcopy(self.network).requires_grad_(False)

    def state(self) -> dict[str, Any]:
        """All there is to remember."""
        return {
            "network": self.network.state_dict(),
            "optimizer": self.optimizer.state_dict(),
            "anchor": None if self.anchor is None else self.anchor.state_dict(),
            "seen": self.seen.state(),
            "told": self.told.state(),
            "earned": self.earned.state(),
            "shown": None if self._shown is None else tuple(self._shown),
        }

    def begin_with(self, state: dict[str, Any]) -> None:
        """Begin with what was learned in another run, whose `state` it is; rewards may be others."""
        self.network.load_state_dict(state["network"])
        self.seen.recall(state["seen"])
        self.told.recall(state["told"])
        self.network.forget(np.flatnonzero(self.seen.is_same()).tolist())

    def recall(self, state: dict[str, Any]) -> None:
        """Return to a `state`."""
        self.network.load_state_dict(state["network"])
        self.optimizer.load_state_dict(state["optimizer"])
        if state["anchor"] is not None:
            self.keep_anchor()
            assert self.anchor is not None
            self.anchor.load_state_dict(state["anchor"])
        self.seen.recall(state["seen"])
        self.told.recall(state["told"])
        self.earned.recall(state["earned"])
        shown = state.get("shown")  # not there before teachers were remembered
        self._shown = None if shown is None else _Shown(*shown)

    def _samples(self, rollout: Rollout, anchored: bool) -> _Samples:
        config = self._config
        gained = advantages(
            rollout.rewards, rollout.values, rollout.after, rollout.ended, discount=config.discount, gae=config.gae
        )
        there = None if rollout.active.all() else torch.from_numpy(rollout.active.ravel())

        def flat(steps: npt.NDArray[Any]) -> Tensor:
            line = torch.from_numpy(steps.reshape(-1, *steps.shape[2:]))
            return line if there is None else line[there]

        rows = flat(rollout.rows)
        mask = None if rollout.mask is None else flat(rollout.mask)
        scores = None
        if anchored and self.anchor is not None:
            with torch.no_grad():
                scores = self.anchor.scores(rows, mask)
        return _Samples(
            rows=rows,
            mask=mask,
            state=None if rollout.state is None else flat(rollout.state),
            actions=flat(rollout.actions),
            targets=flat(gained + rollout.values),
            gain=flat(gained),
            log_shares=flat(rollout.log_shares),
            chose=torch.ones(len(rows), dtype=torch.bool) if mask is None else mask.sum(dim=1) > 1,
            anchored=scores,
        )

    def _notice(self, seen: Floats | None, told: Floats | None) -> None:
        if seen is not None and len(seen):
            self.seen.update(seen)
        if told is not None and len(told):
            self.told.update(told)

    def _minibatches(self, n: int, generator: torch.Generator) -> Iterator[Tensor]:
        yield from torch.randperm(n, generator=generator).split(self._config.minibatch_n)

    def _show(self, rollout: Rollout) -> _Shown:
        """What a teacher said in a rollout, where there was a choice."""
        there = rollout.active
        rows, actions = torch.from_numpy(rollout.seen), torch.from_numpy(rollout.actions[there])
        mask = None if rollout.mask is None else torch.from_numpy(rollout.mask[there])
        shares = self._shares(None if rollout.worths is None else rollout.worths[there], mask)
        if mask is None:
            return _Shown(rows, None, actions, shares)
        chose = mask.sum(dim=1) > 1
        return _Shown(rows[chose], mask[chose], actions[chose], None if shares is None else shares[chose])

    def _shares(self, worths: Floats | None, mask: Tensor | None) -> Tensor | None:
        """How often to do actions that are worth so much, shape (n, n_actions)."""
        temperature = self._config.clone_temperature
        if worths is None or not temperature:
            return None
        scores = torch.from_numpy(worths) / temperature
        return torch.softmax(scores if mask is None else scores.masked_fill(~mask, -torch.inf), dim=1)

    def _imitate(self, shown: _Shown, n_epochs: int, rate: float, generator: torch.Generator) -> float:
        """Imitate samples; returns how far the policy was from them, as a mean over all steps."""
        rows = torch.from_numpy(self.seen.apply(shown.rows.numpy()))
        chose = torch.ones(len(rows), dtype=torch.bool) if shown.mask is None else shown.mask.sum(dim=1) > 1
        losses = []
        for _ in range(n_epochs):
            for picked in self._minibatches(len(rows), generator):
                legal = None if shown.mask is None else shown.mask[picked]
                shares = None if shown.shares is None else shown.shares[picked]
                loss = self._imitation(rows[picked], legal, shown.actions[picked], chose[picked], shares)
                self._step(loss, rate)
                losses.append(loss.item())
        return float(np.mean(losses)) if losses else float("nan")

    def _imitation(
        self, rows: Tensor, mask: Tensor | None, actions: Tensor, chose: Tensor, shares: Tensor | None = None
    ) -> Tensor:
        """Mean distance from a teacher who had a choice and did what is legal, or from shares of actions."""
        if mask is not None:
            chose = chose & mask.gather(1, actions[:, None]).squeeze(1)
        if not chose.any():
            return torch.zeros(())
        scores = self.network.scores(rows[chose], None if mask is None else mask[chose])
        if shares is not None:
            return self.network.cross_entropy(scores, shares[chose]).mean()
        return self.network.imitation(scores, actions[chose]).mean()

    def _descend(self, samples: _Samples, rate: float, anchor: float) -> tuple[float, ...]:
        """One gradient step on the clipped objective, eq. (7) and (9) of the paper."""
        config = self._config
        value_loss = 0.5 * ((self.network.value(samples.rows, samples.state) - samples.targets) ** 2).mean()
        loss = config.value * value_loss
        told = [value_loss.detach(), *torch.zeros(4)]
        samples = samples.choosing()
        if len(samples.rows):
            gain = (samples.gain - samples.gain.mean()) / (samples.gain.std(correction=0) + 1e-8)
            scores = self.network.scores(samples.rows, samples.mask)
            log_shares, entropies = self.network.judge(scores, samples.actions)
            change = log_shares - samples.log_shares
            ratio = change.exp()
            clipped = ratio.clamp(1.0 - config.clip, 1.0 + config.clip)
            policy_loss = -torch.minimum(ratio * gain, clipped * gain).mean()
            entropy = entropies.mean()
            loss = loss + policy_loss - config.entropy * entropy
            if samples.anchored is not None and self.anchor is not None:
                spread = None if self.network.discrete else self.anchor.log_std
                loss = loss + anchor * self.network.divergence(scores, samples.anchored, spread).mean()
            with torch.no_grad():
                divergence = (ratio - 1.0 - change).mean()  # J. Schulman, "Approximating KL Divergence", 2020: k3
                outside = ((ratio - 1.0).abs() > config.clip).float().mean()
            told[1:] = [one.detach() for one in (policy_loss, entropy, divergence, outside)]
        self._step(loss, rate)
        return tuple(torch.stack(told).tolist())

    def _step(self, loss: Tensor, rate: float) -> None:
        if not loss.requires_grad:
            return
        for group in self.optimizer.param_groups:
            group["lr"] = rate
        self.optimizer.zero_grad()
        loss.backward()
        torch.nn.utils.clip_grad_norm_(self.network.parameters(), self._config.max_grad_norm)
        self.optimizer.step()


def _tensor(array: npt.NDArray[Any] | None) -> Tensor | None:
    return None if array is None else torch.from_numpy(array)
