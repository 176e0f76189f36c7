"""Hall: a warehouse that obeys by VDA 5050 and a master of ours, as the programs that users start."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from tests.interop.table import REPOSITORY

END_S = 300.0
"""How long a run may take to end when it is interrupted [s]."""


@contextmanager
def serving(url: str, folder: Path, *words: str) -> Iterator[dict[str, Any]]:
    """A warehouse that obeys; yields a dict that has the result of its run when it has ended."""
    told: dict[str, Any] = {}
    words = ("serve", "--vda5050", url, "--duration", "36000", "--out", str(folder), "--check", *words)
    program = [sys.executable, "-m", "fleet", *words]
    with subprocess.Popen(program, cwd=REPOSITORY, stdout=subprocess.PIPE, text=True) as fleet:
        assert fleet.stdout is not None
        try:
            assert "cars speak VDA 5050" in fleet.stdout.readline()
            yield told
        finally:
            fleet.send_signal(signal.SIGINT)
            fleet.communicate(timeout=END_S)
    told |= json.loads((folder / "result.json").read_text(encoding="utf-8"))


def driven(url: str, folder: Path, *words: str, most_s: float) -> dict[str, Any]:
    """Let our master drive vehicles until its orders are done; returns the result of its run."""
    words = ("drive", "--vda5050", url, "--out", str(folder), *words)
    program = [sys.executable, "-m", "fleet", *words]
    done = subprocess.run(program, cwd=REPOSITORY, capture_output=True, text=True, timeout=most_s, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    result: dict[str, Any] = json.loads((folder / "result.json").read_text(encoding="utf-8"))
    return result
