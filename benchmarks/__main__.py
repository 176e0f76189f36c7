"""Run every benchmark: `python -m benchmarks [--quick] [--json FILE] [NAME ...]`."""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

from benchmarks import BENCHMARKS
from benchmarks.harness import EXIT_OK, EXIT_WRONG_RESULT, write_json, write_problem


def main(argv: Sequence[str] | None = None) -> int:
    """Run the named benchmarks, each in a process of its own so that none warms the caches of the next.

    Returns:
        The worst exit status of the benchmarks.
    """
    parser = argparse.ArgumentParser(prog="python -m benchmarks", description="Run benchmarks one after the other.")
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"default: all of {', '.join(BENCHMARKS)}")
    parser.add_argument("--quick", action="store_true", help="the same rows from few repetitions")
    parser.add_argument("--json", type=Path, metavar="FILE", help="also write the list of all reports to FILE")
    options = parser.parse_args(argv)

    unknown = [name for name in options.names if name not in BENCHMARKS]
    if unknown:
        parser.error(f"no benchmark {unknown[0]!r}; valid: {', '.join(BENCHMARKS)}")
    if options.json is not None and (problem := write_problem(options.json)):
        parser.error(f"--json {options.json}: {problem}")

    statuses: list[int] = []
    reports = []
    with tempfile.TemporaryDirectory() as folder:
        for name in options.names or BENCHMARKS:
            output = Path(folder) / f"{name}.json"
            command = [sys.executable, "-m", f"benchmarks.{name}", "--json", str(output)]
            statuses.append(_run([*command, "--quick"] if options.quick else command))
            if output.exists():
                reports.append(json.loads(output.read_text(encoding="utf-8")))
    if options.json is not None:
        write_json(options.json, {"benchmarks": reports})
    return max(statuses, default=EXIT_OK)


def _run(command: list[str]) -> int:
    """Return the exit status of `command`; one that a signal ended has shown no right result."""
    status = subprocess.run(command, check=False).returncode
    return status if status >= 0 else EXIT_WRONG_RESULT


if __name__ == "__main__":
    raise SystemExit(main())
