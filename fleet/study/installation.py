"""Installation: what is installed on a machine and decides the figures of a run there."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from functools import cache
from importlib.util import find_spec
from pathlib import Path

from fleet.recording.run_file import versions

SOURCE = "fleet (digest of its source)"
_LAYERS = ("fleet", "maps", "planners")
_SUFFIXES = (".in", ".py", ".toml")
"""Of files that decide what a run does: code, descriptions of robots, sites."""


@cache
def installation() -> Mapping[str, str]:
    """Versions of Python and of the packages that can change a result, and a digest of this project's own source."""
    return {SOURCE: _source_digest(), **versions()}


def first_difference(here: Mapping[str, str], there: Mapping[str, str]) -> str:
    """What two installations do not have in common, such as ``numpy 2.2.1 here, 2.1.0 there``; empty if nothing."""
    for name in (*here, *there):
        if here.get(name) != there.get(name):
            return f"{name} {here.get(name, 'none')} here, {there.get(name, 'none')} there"
    return ""


def _source_digest() -> str:
    """12 hexadecimal digits that are the same where all three layers are the same to the byte."""
    digest = hashlib.sha256()
    for layer in _LAYERS:
        spec = find_spec(layer)
        for root in map(Path, (spec and spec.submodule_search_locations) or ()):
            for path in sorted(path for path in root.rglob("*") if path.suffix in _SUFFIXES):
                name = f"{layer}/{path.relative_to(root).as_posix()}"
                digest.update(f"{name}\0{path.stat().st_size}\0".encode())
                digest.update(path.read_bytes())
    return digest.hexdigest()[:12]
