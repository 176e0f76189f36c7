"""Start: what only tells or lists is there at once, and loads nothing that computes."""

from __future__ import annotations

import json
from collections.abc import Iterable

from benchmarks.first_hour.newcomer import Newcomer
from benchmarks.harness import Kind, Row, Trial

HEAVY = ("numba", "pybullet", "torch", "rerun")
REPEATS = 5
LOADED = """
import atexit, json, os, sys
told = os.dup(2)
atexit.register(lambda: os.write(told, json.dumps(sorted({name.partition(".")[0] for name in sys.modules})).encode()))
from fleet.cli.main import main
main(sys.argv[1:], prog="fleet")
"""


def measure_start(trial: Trial, newcomer: Newcomer) -> Iterable[Row]:
    """Ask for help and for the sites that ship, some times each; the least time counts, and the first is left out."""
    if missing := newcomer.missing:
        trial.notes.append(f"start: left out: {missing}")
        return
    for words in ("--help", "site list"):
        took = [newcomer.calls(f"fleet {words}") for _ in range(1 + REPEATS)][1:]
        trial.check(all(one.status == 0 for one in took), f"fleet {words}: {took[0].told}")
        least_s = min(one.cpu_s for one in took)
        yield Row(name=f"fleet {words}, computing", value=least_s, unit="s", kind=Kind.TIME, target="<= 0.5")
        loaded = newcomer.calls(f"python -c '{LOADED}' {words}")
        heavy = set(json.loads(loaded.err.strip().splitlines()[-1])) & set(HEAVY)
        if heavy:
            trial.notes.append(f"fleet {words} loads {', '.join(sorted(heavy))}")
        yield Row(name=f"fleet {words}, of {', '.join(HEAVY)} loaded", value=len(heavy), unit="", target="<= 0")
