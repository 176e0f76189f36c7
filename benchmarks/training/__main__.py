"""Run the training benchmark: `python -m benchmarks.training [--quick] [--only GROUP ...] [--json FILE]`."""

from benchmarks.harness import main
from benchmarks.training import BENCHMARK

raise SystemExit(main(BENCHMARK))
