"""Check: reads a recording back and says what is in it."""

from __future__ import annotations

import tempfile
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from fleet.recording.errors import RecordingError
from fleet.recording.rerun_cli import run_rerun

_FRAME_ENTITY = "/world/cars/body"
_NO_FOOTER = "no footer: the recording was cut off and is readable up to there; repair: fleet mend RUN"


@dataclass(frozen=True, kw_only=True)
class RecordingReport:
    """What a recording holds."""

    entities: frozenset[str]
    """Paths with data, without rerun's own properties."""
    frames: int
    last_sim_s: float
    """Simulated time of the last frame [s]; not a number without frames."""
    verified: bool
    """True if ``rerun rrd verify`` accepts the file: complete, with its footer."""
    note: str
    """What is wrong with it, and what helps; empty if nothing is."""

    def missing(self, *roots: str) -> tuple[str, ...]:
        """Those of the given entity paths that have no data at or below them."""
        return tuple(
            root for root in roots if not any(path == root or path.startswith(f"{root}/") for path in self.entities)
        )


def verify_recording(path: Path) -> RecordingReport:
    """Read a recording to its end.

    Args:
        path: A finished file, or the one a killed process left.

    Returns:
        The report.

    Raises:
        RecordingError: There is no file, or it is no recording.
    """
    if not path.is_file():
        raise RecordingError(f"no recording at {path}")
    try:
        entities, times = _scan(path)
    except (OSError, RuntimeError, ValueError) as error:
        entities, times = _scan_repaired(path, error)
    sim_s = np.unique(np.concatenate(times)) if times else np.empty(0)
    checked = run_rerun(["rrd", "verify", str(path)])
    complaint = (checked.stderr.strip() or checked.stdout.strip()).splitlines()
    note = ""
    if checked.returncode:
        note = _NO_FOOTER if "footer" in " ".join(complaint).lower() else (complaint or ["rejected"])[-1]
    return RecordingReport(
        entities=frozenset(path for path in entities if not path.startswith("/__")),
        frames=len(sim_s),
        last_sim_s=float(sim_s[-1]) if len(sim_s) else float("nan"),
        verified=checked.returncode == 0,
        note=note,
    )


@contextmanager
def repaired(path: Path) -> Iterator[Path]:
    """A copy of a recording up to where it is whole, gone afterwards; there is none of what is no recording."""
    with tempfile.TemporaryDirectory() as directory:
        copy = Path(directory) / "repaired.rrd"
        run_rerun(["rrd", "optimize", str(path.resolve()), "-o", str(copy)])
        yield copy


def _scan(path: Path) -> tuple[set[str], list[np.ndarray]]:
    """Entities with data, and the times of the frames chunk by chunk [s]."""
    from rerun.chunk import RrdReader

    entities: set[str] = set()
    times: list[np.ndarray] = []
    with warnings.catch_warnings():
        # of a missing footer, which the report tells
        warnings.simplefilter("ignore")
        for chunk in RrdReader(path).stream():
            entities.add(str(chunk.entity_path))
            if chunk.entity_path == _FRAME_ENTITY and not chunk.is_static:
                column = chunk.to_record_batch().column("sim_time")
                # as integers: python's durations have no nanoseconds
                times.append(column.cast("int64").to_numpy() * 1e-9)
    return entities, times


def _scan_repaired(path: Path, error: Exception) -> tuple[set[str], list[np.ndarray]]:
    """The same for a file that ends inside a message, by way of a repaired copy."""
    with repaired(path) as copy:
        try:
            return _scan(copy)
        except (OSError, RuntimeError, ValueError):
            raise RecordingError(f"{path} cannot be read as a recording: {error}") from error
