"""Kernel cache: where compiled kernels are kept if neither the source tree nor the home directory can be written.

Numba keeps a kernel beside its source or in the user's cache directory, and refuses to compile where it can write to
neither, as in a container or on a cluster. This module is imported first and itself imports next to nothing.
"""

from __future__ import annotations

import os
import stat
import sys
from contextlib import suppress

VARIABLE = "NUMBA_CACHE_DIR"
"""Variable of the environment that numba reads when it is imported, and that child processes inherit."""
PACKAGES = ("fleet", "planners")
"""Packages with kernels."""


def provide_kernel_cache() -> None:
    """Name a temporary directory to numba, and say so in one line, if kernels can be kept nowhere else."""
    if os.name != "posix":
        return
    chosen, users = os.environ.get(VARIABLE), _users_cache()
    if (chosen and _writable(chosen)) or _writable(users) or _source_writable():
        return
    folder = _temporary()
    os.environ[VARIABLE] = folder
    if (numba := sys.modules.get("numba")) is not None:
        numba.config.CACHE_DIR = folder  # it has read its environment already
    print(  # noqa: T201 - there is nobody else to say it
        "fleet: neither the source tree nor the home directory can be written, so compiled kernels are kept in "
        f"{folder}; {VARIABLE} names another directory",
        file=sys.stderr,
    )


def _users_cache() -> str:
    """The cache directory of the user, in which numba makes one of its own."""
    if sys.platform == "darwin":
        return os.path.expanduser("~/Library/Caches/numba")
    return os.path.join(os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache"), "numba")


def _source_writable() -> bool:
    """Whether numba can keep every kernel beside its source."""
    root = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))
    return all(
        _writable(os.path.join(folder, "__pycache__"))
        for package in PACKAGES
        for folder, _, _ in os.walk(os.path.join(root, package))
        if os.path.basename(folder) != "__pycache__"
    )


def _writable(folder: str) -> bool:
    """Whether files can be put into a directory, or it can be made."""
    while not os.path.lexists(folder):
        folder = os.path.dirname(folder) or os.curdir
    return os.path.isdir(folder) and os.access(folder, os.W_OK | os.X_OK)


def _temporary() -> str:
    """A temporary directory of this user, the same in every run; another one if somebody else got hold of the name.

    Kernels are code: whoever can write to their directory decides what a run does.
    """
    import tempfile

    folder = os.path.join(tempfile.gettempdir(), f"fleet-kernels-{os.getuid()}")
    with suppress(FileExistsError):
        os.mkdir(folder, 0o700)
    found = os.lstat(folder)
    ours = stat.S_ISDIR(found.st_mode) and found.st_uid == os.getuid() and stat.S_IMODE(found.st_mode) == 0o700
    return folder if ours else tempfile.mkdtemp(prefix="fleet-kernels-")
