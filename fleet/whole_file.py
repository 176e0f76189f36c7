"""WholeFile: a file, or a folder of files, is there as a whole or not at all, also where the disk is full."""

from __future__ import annotations

import errno
import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
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
    with draft_of(path) as draft:
        draft.write_bytes(content.encode() if isinstance(content, str) else content)


@contextmanager
def draft_of(path: Path) -> Iterator[Path]:
    """A file to write beside another one, whose place it takes in one step at the end if nothing was raised.

    What is no file, such as a device, is its own draft.

    Args:
        path: The file that it becomes; a link is followed.

    Raises:
        OSError: It cannot be written, or not take the place; names the path, and leaves what was there.
    """
    is_file = not path.exists() or path.is_file()
    target = path.resolve()
    draft = target.with_name(f".{target.name}.part") if is_file else path
    try:
        yield draft
        if is_file:
            with draft.open("rb+") as file:
                os.fsync(file.fileno())
            draft.replace(target)
    except OSError as error:
        if error.filename in (None, str(draft)):
            raise OSError(error.errno, error.strerror, str(path)) from error
        raise
    finally:
        if is_file:
            draft.unlink(missing_ok=True)


def require_place(path: Path) -> None:
    """See that a file can be written at a path before it has taken a long time to make; leaves nothing behind.

    A file is made beside it: rights do not tell it of `/proc`.

    Raises:
        OSError: It cannot; names the path.
    """
    special = path.exists() and not path.is_file()
    if path.is_dir() or (special and not os.access(path, os.W_OK)):
        number = errno.EISDIR if path.is_dir() else errno.EACCES
        raise OSError(number, os.strerror(number), str(path))
    if special:
        return
    try:
        with tempfile.TemporaryFile(dir=path.parent):
            pass
    except OSError as error:
        raise OSError(error.errno, error.strerror, str(path)) from error


@contextmanager
def whole_folder(folder: Path) -> Iterator[None]:
    """Make a folder in which files are written; if one of them cannot be, what was made here is taken away again.

    Args:
        folder: Made with its parents. One that was there is kept, with what is in it.

    Raises:
        OSError: It cannot be made, or a file in it not be written.
    """
    missing = [path for path in (folder, *folder.parents) if not path.exists()]
    try:
        folder.mkdir(parents=True, exist_ok=True)
        yield
    except OSError:
        if folder in missing:
            shutil.rmtree(folder, ignore_errors=True)
        for path in missing[1:]:
            with suppress(OSError):
                path.rmdir()
        raise
