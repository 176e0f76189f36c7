"""Instances that others published, outside the repository: where they are, and what to do without them."""

from __future__ import annotations

import os
from pathlib import Path

from benchmarks.harness import Trial
from maps.formats.movingai import read_map
from maps.grid import GridMap

INSTANCES = Path(os.environ.get("FLEET_INSTANCES", Path(__file__).resolve().parents[3] / "shared" / "instances"))
"""Folder of the instances; the environment variable FLEET_INSTANCES names another one."""


def find(trial: Trial, name: str, *, what: str) -> Path | None:
    """Path of an instance file, or None, and a note that `what` is left out.

    Args:
        trial: Receives the note.
        name: Path inside the folder of instances, such as ``lorr2024/RANDOM-01.json``.
        what: Rows that need the file.
    """
    path = INSTANCES / name
    if path.is_file():
        return path
    trial.notes.append(f"{what}: left out, no file {name} in FLEET_INSTANCES={INSTANCES}")
    return None


def find_map(trial: Trial, name: str, *, what: str) -> GridMap | None:
    """Floor of a League map by its name, or None, and a note that `what` is left out."""
    path = find(trial, f"lorr2024/maps/{name}.map", what=what)
    return None if path is None else read_map(path)
