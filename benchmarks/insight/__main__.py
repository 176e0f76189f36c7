"""Run the insight benchmark: `python -m benchmarks.insight [--quick] [--only GROUP ...] [--json FILE]`."""

from benchmarks.harness import main
from benchmarks.insight import BENCHMARK

raise SystemExit(main(BENCHMARK))
