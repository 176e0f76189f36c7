"""Benchmark of the demo command: does every fleet deliver everything without a touch, how fast, and how soon."""

from __future__ import annotations

import csv
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.harness import Benchmark, Kind, Row, Trial, main
from fleet.recording.check import verify_recording

REPOSITORY = Path(__file__).resolve().parents[1]
INSTANCES = Path(os.environ.get("FLEET_INSTANCES", REPOSITORY.parent / "shared" / "instances"))
WAREHOUSE = INSTANCES / "movingai" / "warehouse-10-20-10-2-1.map"
RECORDED = ("/world/cars", "/world/arms", "/world/parcels", "/states/cars", "/states/arms", "/states/tasks")
"""What a recording of a run must hold."""
POLL_S = 0.02


def measure(trial: Trial) -> Iterator[Row]:
    """Run the fleets of the table; `trial.seeds` counts for three cars on `small`."""
    medium_seeds = trial.seeds[:1] if trial.quick else trial.seeds[:5]
    medium_tasks = 20 if trial.quick else 60
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder)
        three = [_deliver(trial, out, ["--robots", "3", "--seed", str(seed)]) for seed in trial.seeds]
        yield _real_time("real-time factor, 3 cars, recorded", three, ">= 8")
        twenty = [
            _deliver(
                trial,
                out,
                ["--site", "medium", "--robots", "20", "--tasks", str(medium_tasks), "--seed", str(seed)],
            )
            for seed in medium_seeds
        ]
        yield _real_time("real-time factor, 20 cars, recorded", twenty, ">= 1.5")
        kinematic = _run(
            out,
            ["--site", "medium", "--robots", "20", "--tasks", "60", "--fidelity", "kinematic", "--no-record"],
        )
        trial.check(kinematic["tasks_done"] == kinematic["tasks_total"], f"kinematic: {_outcome(kinematic)}")
        yield _real_time("real-time factor, 20 cars, kinematic", [kinematic], ">= 100")
        warm_s = _first_move(out, os.environ.copy())
        yield Row(name="first movement, warm caches", value=warm_s, unit="s", kind=Kind.TIME, target="<= 5")
        cold_s = _first_move(out, _cold_environment(out))
        yield Row(name="first movement, cold caches", value=cold_s, unit="s", kind=Kind.TIME, target="<= 25")
        other = [
            _deliver(trial, out, ["--site", "small", "--robots", n]) for n in (("1",) if trial.quick else ("1", "8"))
        ]
        real = [_real_input(trial, out)] if WAREHOUSE.exists() and not trial.quick else []
        again = _run(out, ["--robots", "3", "--seed", str(trial.seeds[0])])
        trial.check(again["state_hash"] == three[0]["state_hash"], "the same seed ended in another state")
    everything = [*three, *twenty, *other, *real]
    yield Row(name="runs in physics", value=len(everything), unit="runs")
    yield Row(name="tasks delivered", value=_share(everything), unit="of all", target=">= 1")
    yield Row(name="robot contacts", value=_total(everything, "robot_contacts"), unit="", target="<= 0")
    yield Row(name="static contacts", value=_total(everything, "static_contacts"), unit="", target="<= 0")
    yield Row(name="parcels misplaced", value=_total(everything, "parcels_misplaced"), unit="", target="<= 0")
    yield Row(name="parcels lost", value=_total(everything, "parcel_balance"), unit="", target="<= 0")
    yield Row(name="smallest clearance", value=_least(everything), unit="m", target=">= 0.1")
    throughput = float(np.mean([result["throughput_per_h"] for result in twenty]))
    yield Row(name="throughput, 20 cars", value=throughput, unit="tasks/h")


def _real_time(name: str, results: Sequence[dict[str, Any]], target: str) -> Row:
    """Median of simulated seconds per second of wall time."""
    factor = float(np.median([result["real_time_factor"] for result in results]))
    return Row(name=name, value=factor, unit="", kind=Kind.RATE, target=target)


def _deliver(trial: Trial, out: Path, options: Sequence[str]) -> dict[str, Any]:
    """Run in physics with a recording and check all that must be right."""
    result = _run(out, options)
    where = " ".join(options)
    trial.check(result["tasks_done"] == result["tasks_total"], f"{where}: {_outcome(result)}")
    for name in ("robot_contacts", "static_contacts", "parcels_misplaced", "parcel_balance"):
        trial.check(result[name] == 0, f"{where}: {name} is {result[name]}")
    report = verify_recording(out / "recording.rrd")
    missing = report.missing(*RECORDED)
    trial.check(not missing, f"{where}: the recording lacks {', '.join(missing)}")
    return result


def _real_input(trial: Trial, out: Path) -> dict[str, Any]:
    """Ten cars and forty orders on a site converted from a published floor plan."""
    site, orders = out / "warehouse.toml", out / "orders.csv"
    convert = [sys.executable, "-m", "fleet", "site", "convert", str(WAREHOUSE), str(site)]
    subprocess.run(convert, cwd=REPOSITORY, check=True, capture_output=True)
    rng = np.random.default_rng(40)
    with orders.open("w", newline="", encoding="utf-8") as file:
        table = csv.writer(file)
        table.writerow(["id", "release_s", "pick", "drop", "mass_kg", "size_m"])
        for k in range(40):
            pick, drop = rng.integers(1, 5, 2)
            table.writerow([f"o{k}", 6 * k, f"pick_{pick}", f"drop_{drop}", f"{rng.uniform(0.1, 1.5):.2f}", "0.06"])
    return _deliver(trial, out, ["--site", str(site), "--robots", "10", "--orders", str(orders)])


def _run(out: Path, options: Sequence[str]) -> dict[str, Any]:
    command = [sys.executable, "-m", "fleet.demo", "--out", str(out), *options]
    done = subprocess.run(command, cwd=REPOSITORY, capture_output=True, text=True, check=False)
    if done.returncode not in (0, 1):
        raise RuntimeError(f"{' '.join(command)}: exit status {done.returncode}: {done.stderr.strip()}")
    result: dict[str, Any] = json.loads((out / "result.json").read_text(encoding="utf-8"))
    return result


def _first_move(out: Path, environment: dict[str, str]) -> float:
    """Wall time from starting the command to the first motion of a car, as its event file tells it [s]."""
    folder = out / "first_move"
    command = [sys.executable, "-m", "fleet.demo", "--robots", "3", "--out", str(folder)]
    events = folder / "run.jsonl"
    events.unlink(missing_ok=True)
    begin = time.perf_counter()
    process = subprocess.Popen(
        command, cwd=REPOSITORY, env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
    )
    try:
        while time.perf_counter() - begin < 120.0 and process.poll() is None:
            if events.exists() and '"first_move"' in events.read_text(encoding="utf-8"):
                return time.perf_counter() - begin
            time.sleep(POLL_S)
        return float("inf")
    finally:
        process.terminate()
        process.wait()


def _cold_environment(out: Path) -> dict[str, str]:
    """An environment without compiled kernels and fitted models."""
    return {**os.environ, "NUMBA_CACHE_DIR": str(out / "numba"), "FLEET_CACHE": str(out / "cache")}


def _outcome(result: dict[str, Any]) -> str:
    return f"{result['tasks_done']} of {result['tasks_total']} tasks done"


def _share(results: Sequence[dict[str, Any]]) -> float:
    return _total(results, "tasks_done") / _total(results, "tasks_total")


def _total(results: Sequence[dict[str, Any]], name: str) -> float:
    return float(sum(abs(result[name]) for result in results))


def _least(results: Sequence[dict[str, Any]]) -> float:
    return min(result["min_clearance_m"] for result in results if result["min_clearance_m"] is not None)


BENCHMARK = Benchmark(
    name="demo",
    summary="fleets of 1 to 20 cars deliver everything, untouched, in physics",
    measure=measure,
    seeds=tuple(range(20)),
    quick_seeds=(0,),
)

if __name__ == "__main__":
    raise SystemExit(main(BENCHMARK))
