"""A process that computes tiles: reads questions from standard input, writes answers to standard output."""

from __future__ import annotations

import os
import pickle
import sys
import traceback

from fleet.world.tiled.board import TileBoard
from fleet.world.tiled.crew import LocalCrew


def main() -> None:
    """Answer until the input ends."""
    questions = sys.stdin.buffer
    # Libraries print from C to descriptor 1, which carries the answers: give it away.
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)

    def say(answer: object, *, failed: bool = False) -> None:
        answers.write(pickle.dumps((failed, answer), protocol=pickle.HIGHEST_PROTOCOL))
        answers.flush()

    status = 0
    try:
        setup, sizes, memory, numbers = pickle.load(questions)
        try:
            with os.fdopen(memory, "r+b") as file:
                crew = LocalCrew(setup, TileBoard(sizes, file), numbers)
        except Exception as error:
            say(error, failed=True)
            os._exit(1)
        say(None)
        while True:
            tile, question, words = pickle.load(questions)
            try:
                say(crew.ask_all(question, *words) if tile is None else crew.ask(tile, question, *words))
            except Exception as error:
                say(error, failed=True)
    except (EOFError, BrokenPipeError):
        pass
    except BaseException:
        traceback.print_exc()
        status = 1
    # Nothing that libraries do on a normal exit is needed.
    os._exit(status)


if __name__ == "__main__":
    main()
