"""What the tests of training libraries share: they run where the library is installed, and say so where it is not."""

from __future__ import annotations

import importlib.util
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

EXAMPLES = Path(__file__).parents[2] / "docs" / "examples" / "training"


def require_package(package: str, extra: str) -> None:
    """Skip a module's tests where a package is missing."""
    if importlib.util.find_spec(package) is None:
        pytest.skip(f"{package} is not installed (extra {extra})", allow_module_level=True)


@pytest.fixture
def run_example() -> Callable[..., str]:
    """Return what runs an example in a process of its own and returns its output."""

    def run(name: str, *words: str) -> str:
        found = subprocess.run(
            [sys.executable, str(EXAMPLES / name), *words],
            cwd=EXAMPLES.parents[2],
            capture_output=True,
            text=True,
            check=False,
        )
        assert found.returncode == 0, found.stderr[-3000:]
        return found.stdout

    return run
