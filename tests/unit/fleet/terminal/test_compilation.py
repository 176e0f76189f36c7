"""Who waits for kernels to be compiled is told so, once; who does not wait hears nothing."""

import io
import os
import subprocess
import sys
from pathlib import Path

import pytest
from numba import njit

from fleet.terminal.compilation import NOTICE, compilation_told


def test_the_first_compilation_is_told_and_no_other() -> None:
    double, triple = njit(lambda x: 2 * x), njit(lambda x: 3 * x)
    said = io.StringIO()
    with compilation_told(said):
        assert said.getvalue() == ""
        assert (double(1), triple(1)) == (2, 3)
    assert said.getvalue() == NOTICE + "\n"
    with compilation_told(said):
        assert (double(2), triple(2)) == (4, 6)  # compiled before
    assert said.getvalue() == NOTICE + "\n"


@pytest.mark.slow
def test_it_is_told_in_a_pipe_too(repository: Path, tmp_path: Path) -> None:
    """A friction of the first hour: in a container's log, nothing told what took three minutes."""
    done = subprocess.run(
        [*f"{sys.executable} -m fleet.demo --site cell --robots 1 --duration 1 --no-record --fidelity grid".split()],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": str(repository), "NUMBA_CACHE_DIR": str(tmp_path / "kernels")},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0
    assert done.stderr.count(NOTICE) == 1
