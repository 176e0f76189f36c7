"""Newcomer: an empty folder, an environment with nothing but the wheel in it, and what commands take there."""

from __future__ import annotations

import os
import resource
import subprocess
import sys
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

REPOSITORY = Path(__file__).resolve().parents[2]
KEPT = ("LANG", "LC_ALL", "http_proxy", "https_proxy", "no_proxy", "HTTP_PROXY", "HTTPS_PROXY", "NO_PROXY")
"""Variables that a newcomer has, too; those of pip go to pip only."""
TIMEOUT_S = 1800.0


@dataclass(frozen=True, kw_only=True)
class Taken:
    """A command that has ended."""

    words: tuple[str, ...]
    status: int
    out: str
    err: str
    wall_s: float
    cpu_s: float
    """Computing time of the program and of those that it ran."""

    @property
    def told(self) -> str:
        """What it was and how it ended, in one line."""
        lines = (self.err or self.out).strip().splitlines()
        return f"{' '.join(self.words)}: status {self.status}: {lines[-1] if lines else 'nothing said'}"


def take(words: Sequence[str], folder: Path, environment: Mapping[str, str], *, user: int | None = None) -> Taken:
    """Run a command to its end.

    Args:
        words: Program and arguments.
        folder: Where it runs.
        environment: All its variables.
        user: Number of the user and group that it runs as; None = our own. Needs root.
    """
    before, begin = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    done = subprocess.run(
        list(words),
        cwd=folder,
        env=dict(environment),
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        timeout=TIMEOUT_S,
        check=False,
        user=user,
        group=user,
        extra_groups=None if user is None else (),
    )
    after, wall_s = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter() - begin
    return Taken(
        words=tuple(words),
        status=done.returncode,
        out=done.stdout,
        err=done.stderr,
        wall_s=wall_s,
        cpu_s=after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime,
    )


class NoInstallation(Exception):
    """The wheel cannot be built or installed here, such as without a network; says why."""


class Newcomer:
    """Somebody who has nothing but Python and the wheel.

    Args:
        folder: Empty, and nobody else's.
    """

    def __init__(self, folder: Path) -> None:
        folder.chmod(0o755)  # other users may look in
        self.folder = folder
        self.desk = folder / "desk"
        """Where the newcomer works: no file of the project is there."""
        self.desk.mkdir()

    @cached_property
    def wheel(self) -> tuple[Path, Taken]:
        """The wheel of this source tree, and what it took to build it.

        Raises:
            NoInstallation: It could not be built.
        """
        out = self.folder / "wheel"
        words = [sys.executable, "-m", "pip", "wheel", "--quiet", "--no-deps", "--wheel-dir", str(out), str(REPOSITORY)]
        taken = take(words, self.folder, os.environ)
        found = sorted(out.glob("*.whl"))
        if taken.status or len(found) != 1:
            raise NoInstallation(taken.told)
        return found[0], taken

    @cached_property
    def installation(self) -> tuple[Path, Taken]:
        """An environment that was empty and has the wheel, and what pip took.

        Raises:
            NoInstallation: pip failed.
        """
        venv = self.folder / "venv"
        made = take([sys.executable, "-m", "venv", str(venv)], self.folder, os.environ)
        if made.status:
            raise NoInstallation(made.told)
        wheel, _ = self.wheel
        pip = [str(venv / "bin" / "python"), "-m", "pip", "install", "--quiet", "--disable-pip-version-check"]
        taken = take([*pip, str(wheel)], self.folder, os.environ)
        if taken.status:
            raise NoInstallation(taken.told)
        return venv, taken

    @property
    def missing(self) -> str:
        """Why there is no installation; empty if there is one."""
        try:
            venv, _ = self.installation
        except NoInstallation as reason:
            return str(reason)
        return "" if venv.is_dir() else f"{venv} is gone"

    @property
    def variables(self) -> dict[str, str]:
        """The environment of the newcomer: a home of his own, and the programs of the installation."""
        venv, _ = self.installation
        home = self.folder / "home"
        home.mkdir(exist_ok=True)
        kept = {name: os.environ[name] for name in KEPT if name in os.environ}
        return {**kept, "HOME": str(home), "PATH": f"{venv / 'bin'}:/usr/local/bin:/usr/bin:/bin"}

    def calls(self, line: str) -> Taken:
        """Type a line at the desk."""
        return take(["bash", "-c", line], self.desk, self.variables)
