"""Checkpoints: all that a training run needs to go on as if it had not been interrupted."""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import torch

from fleet.training.errors import TrainingError
from fleet.whole_file import write_whole

_FORMAT = 2
_CONTENT = {"config": str, "kinds": dict, "n_state": int, "done": int, "steps": int, "rows": list, "learners": dict}
"""What has to be in one, whoever reads it."""


def write_checkpoint(path: Path, content: dict[str, Any]) -> None:
    """Write a checkpoint, whole or not at all."""
    written = io.BytesIO()
    torch.save({"format": _FORMAT, **content}, written)
    write_whole(path, written.getvalue())


def read_checkpoint(path: Path) -> dict[str, Any]:
    """Read a checkpoint; nothing in it is run as code.

    Raises:
        TrainingError: It is not there, or is no checkpoint.
    """
    try:
        content = torch.load(path, weights_only=True)
    except FileNotFoundError:
        raise TrainingError(f"{path}: there is no checkpoint; valid: a folder of a training run") from None
    except Exception as error:  # a damaged file can make the reader of weights raise anything
        raise TrainingError(f"{path}: cannot be read as a checkpoint; valid: what a training run wrote") from error
    if not isinstance(content, dict) or "format" not in content:
        raise TrainingError(f"{path}: is no checkpoint; valid: what a training run wrote")
    if content["format"] != _FORMAT:
        raise TrainingError(f"{path}: is a checkpoint of format {content['format']}; valid: {_FORMAT}, train again")
    for name, kind in _CONTENT.items():
        if not isinstance(content.get(name), kind):
            raise TrainingError(f"{path}: has no {name}; valid: what a training run wrote")
    return content
