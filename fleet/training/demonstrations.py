"""Demonstrations: what a teacher saw and did, as arrays in a file."""

from __future__ import annotations

import io
import zipfile
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from gymnasium.spaces import Discrete

from fleet.envs.policies.policy import Policy
from fleet.training.batch import AgentType, agent_types, mask_of, type_of, vector, worths_of_done
from fleet.training.errors import TrainingError
from fleet.whole_file import write_whole

_OTHERS = ("mask", "actions", "worths")
_DAMAGED = (OSError, ValueError, TypeError, EOFError, RuntimeError, zipfile.BadZipFile, zlib.error)
"""What reading a damaged archive raises, one that is packed in another way, and an array alone."""


@dataclass(frozen=True, kw_only=True)
class Demonstration:
    """What agents of one type saw and did, in n samples."""

    rows: npt.NDArray[np.float32]
    """Observations, shape (n, n_observed)."""
    mask: npt.NDArray[np.bool_] | None
    """Legal actions, shape (n, n_actions); None without masks."""
    actions: npt.NDArray[Any]
    """As the environment takes them, shape (n,) or (n, n_entries)."""
    worths: npt.NDArray[np.float32] | None = None
    """What each action was worth, shape (n, n_actions); None where nobody said so."""

    def require(self, kind: AgentType, path: Path) -> None:
        """Make sure that it is of these agents.

        Raises:
            TrainingError: Observations, masks, actions or worths are of another shape, or there is no such action.
        """
        n_actions = int(kind.action.n) if isinstance(kind.action, Discrete) else 0
        wanted = {
            "rows": (self.rows.shape[1:], (kind.n_observed,)),
            "actions": (self.actions.shape[1:], kind.action.shape),
            "mask": (None if self.mask is None else self.mask.shape[1:], (n_actions,) if kind.masked else None),
        }
        if self.worths is not None:
            wanted["worths"] = (self.worths.shape[1:], (n_actions,) if n_actions else None)
        for name, (found, valid) in wanted.items():
            if found != valid:
                raise TrainingError(f"{path}: {kind.name}_{name} has rows of shape {found}; valid: {valid}")
        if n_actions:
            odd = self.actions[~np.isin(self.actions, np.arange(n_actions))]
            if len(odd):
                numbers = f"integers from 0 to {n_actions - 1}"
                raise TrainingError(f"{path}: {kind.name}_actions has {odd[0]}; valid: {numbers}")


def write_demonstrations(path: Path, told: Mapping[str, Demonstration]) -> None:
    """Write a file, whole or not at all.

    Args:
        path: An .npz file, with the arrays `<type>_rows`, `<type>_mask`, `<type>_actions` and `<type>_worths`.
        told: By type of agents.
    """
    arrays: dict[str, npt.NDArray[Any]] = {}
    for kind, one in told.items():
        arrays |= {f"{kind}_rows": one.rows, f"{kind}_actions": one.actions}
        if one.mask is not None:
            arrays[f"{kind}_mask"] = one.mask
        if one.worths is not None:
            arrays[f"{kind}_worths"] = one.worths
    content = io.BytesIO()
    np.savez_compressed(content, allow_pickle=False, **arrays)
    write_whole(path, content.getvalue())


def read_demonstrations(path: Path) -> dict[str, Demonstration]:
    """Read a file; nothing in it is run as code, arrays of other names are left alone.

    Raises:
        TrainingError: It cannot be read, an array is missing or of another length, or a number is not finite.
    """
    try:
        with path.open("rb") as source, np.load(source, allow_pickle=False) as file:
            known = [name for name in file.files if name.rpartition("_")[2] in ("rows", *_OTHERS)]
            arrays = {name: file[name] for name in known}
    except _DAMAGED as error:
        raise TrainingError(f"{path}: cannot be read as demonstrations; valid: an .npz file of arrays") from error
    for name, array in arrays.items():
        if array.ndim == 0 or array.dtype.kind not in "biuf":
            raise TrainingError(
                f"{path}: {name} is an array of {array.dtype}, {array.ndim} axes; valid: rows of numbers"
            )
        if not (np.abs(array) <= np.finfo(np.float32).max).all():
            raise TrainingError(f"{path}: {name} has numbers that are not finite in 32 bits; valid: finite ones")
    kinds = [name.rpartition("_")[0] for name in arrays if name.endswith("_rows")]
    if not kinds:
        raise TrainingError(f"{path}: has no array of observations; valid: arrays TYPE_rows, TYPE_actions, TYPE_mask")
    told = {}
    for kind in kinds:
        rows = arrays[f"{kind}_rows"]
        mask, actions, worths = (arrays.get(f"{kind}_{name}") for name in _OTHERS)
        if actions is None:
            raise TrainingError(f"{path}: {kind}_actions is missing; valid: an action for each row")
        for name, array in (("actions", actions), ("mask", mask), ("worths", worths)):
            if array is not None and len(array) != len(rows):
                raise TrainingError(f"{path}: {kind}_{name} has {len(array)} rows of {len(rows)}; valid: one for each")
        told[kind] = Demonstration(
            rows=rows.astype(np.float32),
            mask=None if mask is None else mask == 1,
            actions=actions,
            worths=None if worths is None else worths.astype(np.float32),
        )
    return told


def demonstrate(path: Path, env: Any, policy: Policy, seeds: Sequence[int]) -> int:
    """Play episodes and write what the policy's agents did, the whole file or nothing.

    Agents that have no choice, having one legal action only, teach nothing and are left out.

    Args:
        path: An .npz file with the arrays `<type>_rows`, `<type>_mask` and `<type>_actions`, and `<type>_worths` if the
            policy says what each action was worth (`Weighing`).
        env: A parallel environment.
        policy: Decides for all agents.
        seeds: Of the episodes.

    Returns:
        Samples in the file.
    """
    kinds = {kind.name: kind for kind in agent_types(env)}
    told: dict[str, list[tuple[Any, Any, Any, Any]]] = {name: [] for name in kinds}
    for seed in seeds:
        observations, _ = env.reset(seed=seed)
        while env.agents:
            actions = policy.act(env, observations)
            worths = getattr(policy, "worths", {})
            for agent, seen in observations.items():
                kind = kinds[type_of(agent)]
                mask = mask_of(seen, kind) if kind.masked else None
                if mask is None or np.count_nonzero(mask) > 1:
                    told[kind.name].append((vector(seen), mask, actions[agent], worths.get(agent)))
            observations, *_ = env.step(actions)
            observations = {agent: observations[agent] for agent in env.agents}  # without those that have left
    found = {}
    for name, samples in told.items():
        if samples:
            done = np.stack([np.asarray(one[2]) for one in samples])
            found[name] = Demonstration(
                rows=np.stack([one[0] for one in samples]).astype(np.float32),
                mask=np.stack([one[1] for one in samples]) if kinds[name].masked else None,
                actions=done,
                worths=_worths([one[3] for one in samples], done),
            )
    write_demonstrations(path, found)
    return sum(len(one.actions) for one in found.values())


def _worths(told: Sequence[Any], actions: npt.NDArray[Any]) -> npt.NDArray[np.float32] | None:
    """What actions were worth; where nobody said so, all but the one that was done very little; None if nobody did."""
    n_actions = max((len(one) for one in told if one is not None), default=0)
    if not n_actions:
        return None
    found = worths_of_done(actions, n_actions)
    for sample, one in enumerate(told):
        if one is not None:
            found[sample] = one
    return found
