"""Run the benchmark of robots: `python -m benchmarks.robots [--quick] [--only GROUP ...] [--json FILE]`."""

from benchmarks.harness import main
from benchmarks.robots import BENCHMARK

raise SystemExit(main(BENCHMARK))
