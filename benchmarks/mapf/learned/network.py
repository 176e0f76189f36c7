"""Network: what scores are learned with, in NumPy; a perceptron, cross-entropy, Adam."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from benchmarks.mapf.learned.observation import N_MOVES, N_SEEN, ONE
from benchmarks.mapf.learned.scores import Floats32, Scores

_BATCH = 2048
_CLOSED = np.float32(-1e9)
"""Logit of a move into a wall."""
_FIRST_MOMENT, _SECOND_MOMENT = 0.9, 0.999


@dataclass(frozen=True, kw_only=True, eq=False)
class Samples:
    """What agents saw and what the teacher did, n samples."""

    seen: npt.NDArray[np.int8]
    """Shape (n, N_SEEN)."""
    move: npt.NDArray[np.int8]
    """Number of the teacher's move in the agent's frame, shape (n,)."""
    is_open: npt.NDArray[np.bool_]
    """Moves that lead into no wall, shape (n, N_MOVES)."""

    def __len__(self) -> int:
        return len(self.move)

    @staticmethod
    def joined(parts: list[Samples]) -> Samples:
        """All of them, one after the other."""
        return Samples(
            seen=np.concatenate([part.seen for part in parts]),
            move=np.concatenate([part.move for part in parts]),
            is_open=np.concatenate([part.is_open for part in parts]),
        )


class Network:
    """Weights in training.

    Args:
        hidden: Units of the two hidden layers.
        rng: Draws the weights and the batches.
    """

    def __init__(self, hidden: tuple[int, int], rng: np.random.Generator) -> None:
        h, k = hidden
        self._rng = rng
        # About seventy inputs of a size of one are not 0 at a time.
        self._weights: list[Floats32] = [
            rng.normal(scale=0.12, size=(N_SEEN, h)).astype(np.float32),
            np.zeros(h, dtype=np.float32),
            rng.normal(scale=np.sqrt(2 / h), size=(h, k)).astype(np.float32),
            np.zeros(k, dtype=np.float32),
            rng.normal(scale=0.1, size=(k, N_MOVES)).astype(np.float32),
            np.zeros(N_MOVES, dtype=np.float32),
        ]
        self._mean = [np.zeros_like(weight) for weight in self._weights]
        self._square = [np.zeros_like(weight) for weight in self._weights]
        self._updates = 0

    def scores(self) -> Scores:
        """A copy of the weights as they stand, for observations in bytes."""
        first, *others = (weight.copy() for weight in self._weights)
        return Scores(first / np.float32(ONE), *others)

    def agreement(self, samples: Samples) -> float:
        """Share of the samples in which the best score is that of the teacher's move."""
        agreed = 0
        for begin in range(0, len(samples), _BATCH):
            some = slice(begin, begin + _BATCH)
            logits = self._forward(samples.seen[some], samples.is_open[some])[-1]
            agreed += int((logits.argmax(axis=1) == samples.move[some]).sum())
        return agreed / max(len(samples), 1)

    def train(self, samples: Samples, *, epochs: int, rate: float, last_rate: float) -> float:
        """Learn from samples in random batches, the rate falling along a half cosine.

        Returns:
            Mean cross-entropy of the last tenth of the batches [nat].
        """
        losses = []
        per_epoch = max(len(samples) // _BATCH, 1)
        n_updates = epochs * per_epoch
        order = np.empty(0, dtype=np.int64)
        for update in range(n_updates):
            place = update % per_epoch
            if place == 0:
                order = self._rng.permutation(len(samples))
            some = order[place * _BATCH : (place + 1) * _BATCH]
            fall = 0.5 * (1 + np.cos(np.pi * update / n_updates))
            losses.append(self._update(samples, some, last_rate + (rate - last_rate) * fall))
        return float(np.mean(losses[-max(n_updates // 10, 1) :])) if losses else float("nan")

    def _forward(self, seen: npt.NDArray[np.int8], is_open: npt.NDArray[np.bool_]) -> tuple[Floats32, ...]:
        first, first_bias, second, second_bias, last, last_bias = self._weights
        x = seen.astype(np.float32) / np.float32(ONE)
        a = np.maximum(x @ first + first_bias, 0)
        b = np.maximum(a @ second + second_bias, 0)
        return x, a, b, np.where(is_open, b @ last + last_bias, _CLOSED)

    def _update(self, samples: Samples, some: npt.NDArray[Any], rate: float) -> float:
        x, a, b, logits = self._forward(samples.seen[some], samples.is_open[some])
        told = (np.arange(len(some)), samples.move[some])
        share = np.exp(logits - logits.max(axis=1, keepdims=True))
        share /= share.sum(axis=1, keepdims=True)
        loss = float(-np.log(share[told] + 1e-9).mean())
        share[told] -= 1
        share /= len(some)
        to_b = share @ self._weights[4].T * (b > 0)
        to_a = to_b @ self._weights[2].T * (a > 0)
        slopes = (x.T @ to_a, to_a.sum(0), a.T @ to_b, to_b.sum(0), b.T @ share, share.sum(0))
        self._updates += 1
        rate *= np.sqrt(1 - _SECOND_MOMENT**self._updates) / (1 - _FIRST_MOMENT**self._updates)
        for k, slope in enumerate(slopes):
            self._mean[k] += (1 - _FIRST_MOMENT) * (slope - self._mean[k])
            self._square[k] += (1 - _SECOND_MOMENT) * (slope * slope - self._square[k])
            self._weights[k] -= np.float32(rate) * self._mean[k] / (np.sqrt(self._square[k]) + np.float32(1e-8))
        return loss
