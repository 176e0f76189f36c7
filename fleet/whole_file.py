"""WholeFile: a file is there as a whole or not at all, also where the disk is full."""

from __future__ import annotations

import os
from pathlib import Path


def write_whole(path: Path, content: str | bytes) -> None:
    """Write a file in one step: readers see the old one, the new one, or none, but never a part.

    What is no file, such as a device, is written to as it is.

    Args:
        path: The file; a link is followed.
        content: All of it; text becomes UTF-8.

    Raises:
        OSError: It cannot be written; names the path, and leaves what was there.
    """
    raw = content.encode() if isinstance(content, str) else content
    target = path.resolve()
    draft = target if target.exists() and not target.is_file() else target.with_name(f".{target.name}.part")
    try:
        with draft.open("wb") as file:
            file.write(raw)
            file.flush()
            if draft is not target:
                os.fsync(file.fileno())
                draft.replace(target)
    except OSError as error:
        raise OSError(error.errno, error.strerror, str(path)) from error
    finally:
        if draft is not target:
            draft.unlink(missing_ok=True)
