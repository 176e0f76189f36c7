"""Run the reliability benchmark: `python -m benchmarks.reliability [--quick] [--only GROUP ...] [--json FILE]`."""

from benchmarks.harness import main
from benchmarks.reliability import BENCHMARK

raise SystemExit(main(BENCHMARK))
