"""Reading: a data set as arrays, by type of agents."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq

from fleet.evaluation.dataset.layout import ABOUT, FORMAT, INFO, STEPS
from fleet.evaluation.errors import DatasetError
from maps.reading.text_file import read_json


@dataclass(frozen=True, kw_only=True, eq=False)
class Transitions:
    """Steps of the agents of one type, by episode, agent and step; n of them."""

    rows: npt.NDArray[np.float32]
    """What agents saw, shape (n, n_observed)."""
    next_rows: npt.NDArray[np.float32]
    """What they saw afterwards, the same shape."""
    mask: npt.NDArray[np.bool_] | None
    """Legal actions, shape (n, n_actions); None without masks."""
    actions: npt.NDArray[Any]
    """What they did: whole numbers, shape (n,), or numbers, shape (n, n_entries)."""
    rewards: npt.NDArray[np.float64]
    """Shape (n,)."""
    infos: dict[str, npt.NDArray[np.float64]]
    """What `infos` said, by name, shape (n,)."""
    terminated: npt.NDArray[np.bool_]
    """Shape (n,)."""
    truncated: npt.NDArray[np.bool_]
    """Shape (n,)."""
    episode: npt.NDArray[np.int32]
    """Number of the episode, shape (n,)."""
    step: npt.NDArray[np.int32]
    """Shape (n,)."""
    agent: npt.NDArray[np.str_]
    """Names, shape (n,)."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Dataset:
    """Trajectories of a policy."""

    about: dict[str, Any]
    """What the file `dataset.json` says."""
    types: dict[str, Transitions]
    """By type of agents, such as `car`."""


def read_dataset(folder: str | Path, env: str | None = None) -> Dataset:
    """Read what `fleet dataset` wrote.

    Args:
        folder: Of the data set.
        env: Environment with version that it has to be of, such as `traffic_v1`; None = any.

    Raises:
        DatasetError: It is no data set, was not written to its end, or is one of another environment.
    """
    folder = Path(folder)
    valid = f"valid: a folder that fleet dataset wrote, format {FORMAT}"
    try:
        about = read_json(folder / ABOUT)
        if about["format"] != FORMAT:
            raise DatasetError(f"data set {folder}: format {about['format']!r}; {valid}")
        was = about["env"]
        if env is not None and was != env:
            raise DatasetError(f"data set {folder} is one of {was}; valid: one of {env}")
        table = pq.read_table(folder / STEPS)
        table = table.sort_by([("episode", "ascending"), ("agent", "ascending"), ("step", "ascending")])
        kinds = pc.unique(table["type"]).to_pylist()
        types = {kind: _transitions(table.filter(pc.equal(table["type"], kind))) for kind in kinds}
    except (OSError, ValueError, KeyError, TypeError, pa.ArrowException) as reason:
        raise DatasetError(f"data set {folder}: {reason}; {valid}") from reason
    return Dataset(about=about, types=types)


def _transitions(table: pa.Table) -> Transitions:
    seen = _matrix(table["observation"])
    # The row after a step is the same agent's: its last is one without a step.
    is_step = table["reward"].is_valid().to_numpy(zero_copy_only=False)
    steps = np.flatnonzero(is_step)
    table = table.filter(pa.array(is_step))
    acts = table["action"]
    masks = table["mask"]
    return Transitions(
        rows=seen[steps],
        next_rows=seen[steps + 1],
        mask=None if masks.null_count else _matrix(masks).astype(np.bool_),
        actions=_matrix(acts) if pa.types.is_list(acts.type) else acts.to_numpy(),
        rewards=table["reward"].to_numpy(),
        infos={
            name.removeprefix(INFO): table[name].to_numpy()
            for name in table.column_names
            if name.startswith(INFO) and table[name].null_count < len(table)
        },
        terminated=table["terminated"].to_numpy(),
        truncated=table["truncated"].to_numpy(),
        episode=table["episode"].to_numpy(),
        step=table["step"].to_numpy(),
        agent=np.array(table["agent"].to_pylist()),
    )


def _matrix(column: pa.ChunkedArray) -> npt.NDArray[Any]:
    """A column of lists of one length as an array."""
    numbers: npt.NDArray[Any] = pc.list_flatten(column).combine_chunks().to_numpy()
    return numbers.reshape(len(column), -1)
