"""Studies: how long a study of fleet sizes takes on all cores of this machine."""

from __future__ import annotations

import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

from benchmarks.harness import Kind, Row, Trial

SIZES, ALLOCATORS, SEEDS, SIM_S = "10:50:10", "greedy,hungarian,regret_lns", 5, 3600.0
QUICK_SIZES, QUICK_SEEDS, QUICK_SIM_S = "4:8:4", 1, 60.0


def measure_study(trial: Trial) -> Iterator[Row]:
    """Five fleet sizes, three allocators and five seeds, an hour each, on `medium`."""
    sizes, seeds, sim_s = (QUICK_SIZES, QUICK_SEEDS, QUICK_SIM_S) if trial.quick else (SIZES, SEEDS, SIM_S)
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder)
        command = [sys.executable, "-m", "fleet", "study", "--robots", sizes, "--allocators", ALLOCATORS]
        command += ["--seeds", str(seeds), "--duration", str(sim_s), "--out", str(out)]
        begin = time.perf_counter()
        subprocess.run(command, check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        wall_s = time.perf_counter() - begin
        n_runs = len((out / "study.csv").read_text(encoding="utf-8").splitlines()) - 1
    low, high, step = (int(word) for word in sizes.split(":"))
    n_wanted = len(range(low, high + 1, step)) * len(ALLOCATORS.split(",")) * seeds
    trial.check(n_runs == n_wanted, f"the study has {n_runs} runs of {n_wanted}")
    name = f"study, {n_runs} runs of {sim_s:g} s"
    yield Row(name=name, value=wall_s / 60.0, unit="min", kind=Kind.TIME, target="" if trial.quick else "<= 15")
