"""Run the arm benchmark: `python -m benchmarks.arms [--quick] [--only GROUP ...] [--json FILE]`."""

from benchmarks.arms import BENCHMARK
from benchmarks.harness import main

raise SystemExit(main(BENCHMARK))
