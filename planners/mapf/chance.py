"""Chance inside kernels: one 64-bit state, handed down like a generator."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from planners.mapf.kernel import Int, kernel

Chance = npt.NDArray[np.uint64]
"""State of a stream of random numbers, shape (1,); every draw moves it on."""


def chance_of(rng: np.random.Generator) -> Chance:
    """A stream for kernels, seeded by a generator."""
    return rng.integers(0, 2**64, size=1, dtype=np.uint64)


@kernel
def mixed(word: np.uint64) -> np.uint64:  # pragma: no cover - compiled
    """Spread the bits of a word, so that neighbouring words become strangers.

    Source: Steele, Lea, Flood, "Fast splittable pseudorandom number generators", OOPSLA 2014 (SplitMix64).
    """
    word = (word ^ (word >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    word = (word ^ (word >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return word ^ (word >> np.uint64(31))


@kernel
def next_word(chance: Chance) -> np.uint64:  # pragma: no cover - compiled
    """Next 64 bits."""
    chance[0] += np.uint64(0x9E3779B97F4A7C15)
    word: np.uint64 = mixed(chance[0])
    return word


@kernel
def draw(chance: Chance) -> float:  # pragma: no cover - compiled
    """Next number in [0, 1)."""
    return np.float64(next_word(chance) >> np.uint64(11)) * 2.0**-53


@kernel
def draw_below(chance: Chance, n: Int) -> Int:  # pragma: no cover - compiled
    """Next whole number in 0..n - 1."""
    return np.int64(draw(chance) * n)
