"""Scores: a small network that says how good each move of an agent is, and the file it is kept in."""

from __future__ import annotations

import zipfile
import zlib
from pathlib import Path
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from benchmarks.mapf.learned.observation import N_MOVES, N_SEEN, RADIUS, Seen
from planners.errors import PlanningError
from planners.mapf.kernel import kernel

Floats32 = npt.NDArray[np.float32]

_OBSERVATION = (1, RADIUS, N_SEEN)
"""Version, radius and length of the observations that weights are for."""
_DAMAGED = (OSError, ValueError, TypeError, KeyError, EOFError, zipfile.BadZipFile, zlib.error)


class WeightsError(PlanningError):
    """A file is no weights, or weights for other observations."""


class Scores(NamedTuple):
    """A perceptron with two hidden layers, of h and k units; its input are the bytes of an observation."""

    first: Floats32
    """Shape (N_SEEN, h)."""
    first_bias: Floats32
    second: Floats32
    """Shape (h, k)."""
    second_bias: Floats32
    last: Floats32
    """Shape (k, N_MOVES)."""
    last_bias: Floats32


class Layers(NamedTuple):
    """Working memory of `score`."""

    first: Floats32
    second: Floats32
    last: Floats32
    """Score of each move, shape (N_MOVES,)."""


def layers_of(scores: Scores) -> Layers:
    """Working memory for one agent after the other."""
    return Layers(*(np.empty(len(bias), dtype=np.float32) for bias in scores[1::2]))


def write_scores(path: Path, scores: Scores) -> None:
    """Write weights to an .npz file."""
    with path.open("wb") as file:
        np.savez_compressed(file, allow_pickle=False, observation=np.array(_OBSERVATION), **scores._asdict())


def read_scores(path: Path) -> Scores:
    """Read weights; nothing in the file is run as code.

    Raises:
        WeightsError: The file cannot be read, its arrays do not fit each other, or they are for other observations.
    """
    try:
        with path.open("rb") as source, np.load(source, allow_pickle=False) as file:
            observation = tuple(file["observation"].tolist())
            scores = Scores(*(np.ascontiguousarray(file[name], dtype=np.float32) for name in Scores._fields))
    except _DAMAGED as error:
        valid = ", ".join(("observation", *Scores._fields))
        raise WeightsError(f"{path}: cannot be read as weights; valid: an .npz file with the arrays {valid}") from error
    if observation != _OBSERVATION:
        raise WeightsError(f"{path}: weights are for the observation {observation}; valid: {_OBSERVATION}")
    h, k = len(scores.first_bias), len(scores.second_bias)
    wanted = ((N_SEEN, h), (h,), (h, k), (k,), (k, N_MOVES), (N_MOVES,))
    for name, array, shape in zip(Scores._fields, scores, wanted, strict=True):
        if array.shape != shape or not np.isfinite(array).all():
            raise WeightsError(f"{path}: {name} has shape {array.shape}; valid: {shape}, finite numbers")
    return scores


@kernel
def score(scores: Scores, seen: Seen, layers: Layers) -> None:  # pragma: no cover - compiled
    """Fill `layers.last`: the larger, the better a move. Most of what is seen is 0, and skipped."""
    first, second, last = layers
    for j in range(len(first)):
        first[j] = scores.first_bias[j]
    for k in range(len(seen)):
        if seen[k] != 0:
            weight = np.float32(seen[k])
            for j in range(len(first)):
                first[j] += weight * scores.first[k, j]
    for j in range(len(second)):
        second[j] = scores.second_bias[j]
    for k in range(len(first)):
        if first[k] > 0.0:
            for j in range(len(second)):
                second[j] += first[k] * scores.second[k, j]
    for j in range(len(last)):
        last[j] = scores.last_bias[j]
    for k in range(len(second)):
        if second[k] > 0.0:
            for j in range(len(last)):
                last[j] += second[k] * scores.last[k, j]
