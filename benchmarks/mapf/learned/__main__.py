"""``python -m benchmarks.mapf.learned --seed 0 --out weights.npz``: learn scores of moves."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from benchmarks.mapf.learned.imitation import learn
from benchmarks.mapf.learned.scores import Scores, write_scores


def main() -> None:
    """Read the command line and learn."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.mapf.learned", description=__doc__)
    parser.add_argument("--seed", type=int, default=0, help="seed of floors, weights and batches")
    parser.add_argument("--out", type=Path, required=True, help="file for the weights")
    arguments = parser.parse_args()

    def tell(line: str, scores: Scores) -> None:
        sys.stderr.write(f"{line}\n")
        sys.stderr.flush()
        write_scores(arguments.out, scores)

    learn(arguments.seed, tell=tell)


if __name__ == "__main__":
    main()
