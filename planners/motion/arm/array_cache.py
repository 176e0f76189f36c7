"""Arrays that are slow to compute, remembered on disk in a directory the caller names."""

from __future__ import annotations

import hashlib
import os
import tempfile
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path
from zipfile import BadZipFile

import numpy as np
import numpy.typing as npt

Arrays = dict[str, npt.NDArray[np.generic]]


def cached_arrays(
    directory: Path | None, name: str, inputs: Sequence[npt.ArrayLike], compute: Callable[[], Arrays]
) -> Arrays:
    """Compute arrays once per distinct input.

    Args:
        directory: Where the .npz files live (made if missing); None computes without a cache.
        name: File name prefix; it must change when the computation changes.
        inputs: Everything the result depends on; shapes, types and bytes make the key.
        compute: The computation.

    Returns:
        The arrays of `compute`, by name.
    """
    if directory is None:
        return compute()
    digest = hashlib.sha256()
    for item in inputs:
        array = np.ascontiguousarray(item)
        digest.update(f"{array.dtype.str}{array.shape}".encode())
        digest.update(array.tobytes())
    path = Path(directory) / f"{name}-{digest.hexdigest()[:32]}.npz"
    # A cache that is absent, damaged or read-only costs time and nothing else.
    with suppress(OSError, ValueError, EOFError, BadZipFile), np.load(path) as stored:
        return dict(stored)
    arrays = compute()
    with suppress(OSError):
        path.parent.mkdir(parents=True, exist_ok=True)
        # Written aside and renamed: several worker processes may fill the cache at once.
        handle, aside = tempfile.mkstemp(dir=path.parent, suffix=".part")
        with os.fdopen(handle, "wb") as file:
            np.savez(file, **arrays)  # type: ignore[arg-type]
        Path(aside).replace(path)
    return arrays
