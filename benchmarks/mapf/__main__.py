"""Run the path planning benchmark: `python -m benchmarks.mapf [--quick] [--only GROUP ...] [--json FILE]`."""

from benchmarks.harness import main
from benchmarks.mapf import BENCHMARK

raise SystemExit(main(BENCHMARK))
