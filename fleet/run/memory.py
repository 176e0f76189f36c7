"""Memory: what a run keeps to its end is not looked through by the collector again and again."""

from __future__ import annotations

import gc
from collections.abc import Iterator
from contextlib import contextmanager

NEW_OBJECTS = 20_000
"""So many new objects before the collector looks at them. A run makes some hundred a tick and few of them in circles,
which nothing else frees: with Python's 700, a tenth of the processor time of 50 cars went into looking."""


@contextmanager
def settled() -> Iterator[None]:
    """Leave what there is now alone until the end, and look at what is new less often."""
    before = gc.get_threshold()
    gc.freeze()
    gc.set_threshold(NEW_OBJECTS, *before[1:])
    try:
        yield
    finally:
        gc.set_threshold(*before)
        gc.unfreeze()
