"""Run the scheduling benchmark: `python -m benchmarks.scheduling [--quick] [--only GROUP ...] [--json FILE]`."""

from benchmarks.harness import main
from benchmarks.scheduling import BENCHMARK

raise SystemExit(main(BENCHMARK))
