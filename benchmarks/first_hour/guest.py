"""Guest: a user without rights, in a folder that is not his, who can write to nothing but a temporary folder."""

from __future__ import annotations

import json
import os
import shutil
import sys
from collections.abc import Iterable
from pathlib import Path

from benchmarks.first_hour.newcomer import KEPT, Newcomer, take
from benchmarks.harness import Kind, Row, Trial

NOBODY = 65534
"""Number of the user and group that own nothing, on Linux."""


def measure_guest(trial: Trial, newcomer: Newcomer) -> Iterable[Row]:
    """Run the demo twice: the first compiles kernels, the second finds them."""
    if os.name != "posix" or os.geteuid() != 0:
        trial.notes.append("guest: left out: only root may run programs as another user")
        return
    if missing := newcomer.missing:
        trial.notes.append(f"guest: left out: {missing}")
        return
    venv, _ = newcomer.installation
    python = _python_for_all(newcomer.folder)
    if python is None:
        trial.notes.append("guest: left out: no Python of this version that every user may run")
        return
    spare = newcomer.folder / "spare"
    spare.mkdir()
    os.chown(spare, NOBODY, NOBODY)
    (packages,) = (venv / "lib").glob("python*/site-packages")
    variables = {name: os.environ[name] for name in KEPT if name in os.environ} | {
        "HOME": "/nonexistent",
        "PATH": "/usr/bin:/bin",
        "PYTHONPATH": str(packages),
        "PYTHONDONTWRITEBYTECODE": "1",
        "TMPDIR": str(spare),
    }
    try:
        for number, name in enumerate(("demo of a guest, the first one", "demo of a guest, again")):
            out = spare / f"run_{number}"
            words = [python, "-m", "fleet", "demo", "--out", str(out)]
            demo = take(words, newcomer.folder, variables, user=NOBODY)
            result = out / "result.json"
            done = json.loads(result.read_text(encoding="utf-8")) if result.exists() else {}
            trial.check(demo.status == 0 and done.get("tasks_done") == 6, f"{name}: {demo.told}")
            trial.check(number == 1 or _is_told_where(demo.err), f"{name}: does not say where kernels are kept")
            yield Row(name=f"{name}, tasks done", value=done.get("tasks_done", 0), unit="of 6", target=">= 6")
            yield Row(name="  wall", value=demo.wall_s, unit="s", kind=Kind.TIME)
            yield Row(name="  computing", value=demo.cpu_s, unit="s", kind=Kind.TIME)
    finally:
        shutil.rmtree(spare, ignore_errors=True)


def _is_told_where(said: str) -> bool:
    """Whether a run says in one line where it keeps its kernels."""
    return sum("NUMBA_CACHE_DIR" in line for line in said.splitlines()) == 1


def _python_for_all(folder: Path) -> str | None:
    """A Python of our version that a user without rights can run."""
    version = f"{sys.version_info.major}.{sys.version_info.minor}"
    for program in (os.path.realpath(sys.executable), f"/usr/bin/python{version}", f"/usr/local/bin/python{version}"):
        code = f"import sys; sys.exit({sys.version_info[:2]} != sys.version_info[:2])"
        try:
            if take([program, "-c", code], folder, {"HOME": "/nonexistent"}, user=NOBODY).status == 0:
                return program
        except OSError:
            continue
    return None
