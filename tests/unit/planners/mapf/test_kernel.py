"""Kernels that are kept on disk must not outlive the kernels they call."""

from __future__ import annotations

from pathlib import Path

import planners.mapf
from planners.mapf import kernel as kernels
from planners.mapf.lacam.configuration_tree import _search
from planners.mapf.lacam.lns import _improve
from planners.mapf.lacam.turning import _drive


def test_a_kernel_is_kept_only_until_any_file_of_the_family_changes() -> None:
    """Numba's own stamp is that of the file the kernel stands in; this reaches into it, so that an update shows."""
    newest = max(path.stat().st_mtime for path in Path(planners.mapf.__file__).parent.rglob("*.py"))
    for compiled in (_search, _improve, _drive):
        assert compiled._cache._cache_file._source_stamp == kernels._STAMP
    assert kernels._STAMP[0] == newest
