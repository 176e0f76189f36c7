"""Chance inside kernels: one 64-bit state, handed down like a generator."""

from __future__ import annotations

import numpy as np

from planners.motion.arrays import Chance
from planners.motion.kernel import kernel


@kernel
def uniform(state: Chance) -> float:
    """Next number in [0, 1) of a SplitMix64 stream (Steele, Lea, Flood, OOPSLA 2014); `state` is uint64 (1,)."""
    state[0] += np.uint64(0x9E3779B97F4A7C15)
    z = state[0]
    z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    z = z ^ (z >> np.uint64(31))
    part: float = (z >> np.uint64(11)) * (1.0 / 9007199254740992.0)
    return part
