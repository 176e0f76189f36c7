"""Run the interop benchmark: `python -m benchmarks.interop [--quick] [--only GROUP ...] [--json FILE]`."""

from benchmarks.harness import main
from benchmarks.interop import BENCHMARK

raise SystemExit(main(BENCHMARK))
