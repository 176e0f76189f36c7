"""The arm planning process: reads requests from standard input, writes answers to standard output."""

from __future__ import annotations

import os
import pickle
import sys

from fleet.errors import FleetError


def main() -> None:
    """Answer until the input ends."""
    # Libraries print from C to descriptor 1, which carries the answers: give it away first.
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
    from fleet.stations.arms.arm_planner import FAILED, KEEP_TREES, READY, LocalArmPlanner

    requests = sys.stdin.buffer
    try:
        planner = LocalArmPlanner(pickle.load(requests))
        _answer(answers, READY, None)
        while True:
            ticket, request = pickle.load(requests)
            if ticket == KEEP_TREES:
                planner.keep_trees()
            else:
                _answer(answers, ticket, planner.answer(request))
    except (EOFError, BrokenPipeError):
        pass
    except FleetError as error:
        _answer(answers, FAILED, str(error))
    except Exception as error:
        _answer(answers, FAILED, f"{type(error).__name__}: {error}")
    answers.flush()
    # OMPL's binding complains on a normal exit.
    os._exit(0)


def _answer(pipe: object, ticket: int, answer: object) -> None:
    pickle.dump((ticket, answer), pipe, protocol=pickle.HIGHEST_PROTOCOL)  # type: ignore[arg-type]
    pipe.flush()  # type: ignore[attr-defined]


if __name__ == "__main__":
    main()
