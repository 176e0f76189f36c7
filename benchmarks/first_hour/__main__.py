"""Run the first hour: `python -m benchmarks.first_hour [--quick] [--only GROUP ...] [--json FILE]`."""

from benchmarks.first_hour import BENCHMARK
from benchmarks.harness import main

raise SystemExit(main(BENCHMARK))
