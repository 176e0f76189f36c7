"""Only what Python writes on purpose reaches the output."""

import os
import subprocess
import sys
from pathlib import Path

SCRIPT = """
import os, sys
from fleet.terminal.console import own_output
own_output()
os.write(1, b"from C, out\\n")
os.write(2, b"from C, err\\n")
print("ours, out")
print("ours, err", file=sys.stderr)
"""


def test_what_libraries_print_from_c_is_dropped(repository: Path) -> None:
    ended = subprocess.run(
        [sys.executable, "-c", SCRIPT], cwd=repository, env=os.environ, capture_output=True, text=True, check=True
    )
    assert (ended.stdout, ended.stderr) == ("ours, out\n", "ours, err\n")
