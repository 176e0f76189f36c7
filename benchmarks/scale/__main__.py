"""Run the scale benchmark: `python -m benchmarks.scale [--quick] [--only GROUP ...] [--json FILE]`."""

from benchmarks.harness import main
from benchmarks.scale import BENCHMARK

raise SystemExit(main(BENCHMARK))
