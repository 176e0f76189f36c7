"""The arm planning process: reads requests from standard input, writes answers to standard output."""

from __future__ import annotations

import os
import pickle
import sys
import threading
import time

from fleet.errors import FleetError
from fleet.stations.arms.arm_process import BEAT, FAILED, KEEP_TREES, READY

BEAT_S = 1.0
"""Wall time between two beats [s]."""
WORK_S = 0.01
"""Processor time since the last beat for which there is another; looking for it alone takes minutes to need it [s]."""


class Voice:
    """Says messages whole, one after the other, whichever thread they come from."""

    def __init__(self) -> None:
        # Libraries print from C to descriptor 1, which carries the answers: give it away.
        self._pipe = os.fdopen(os.dup(1), "wb")
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
        self._lock = threading.Lock()

    def say(self, word: int, content: object = None) -> None:
        """Say one message.

        Raises:
            BrokenPipeError: Nobody listens any more.
        """
        with self._lock:
            pickle.dump((word, content), self._pipe, protocol=pickle.HIGHEST_PROTOCOL)
            self._pipe.flush()


def main() -> None:
    """Answer until the input ends."""
    voice = Voice()
    threading.Thread(target=_beat, args=(voice,), daemon=True).start()
    try:
        _answer(voice)
    except (EOFError, BrokenPipeError):
        pass
    except FleetError as error:
        voice.say(FAILED, str(error))
    except Exception as error:
        voice.say(FAILED, f"{type(error).__name__}: {error}")
    # OMPL's binding complains on a normal exit.
    os._exit(0)


def _answer(voice: Voice) -> None:
    # Loaded while the beats go on: that takes seconds, and minutes if kernels have to be compiled.
    from fleet.stations.arms.arm_planner import LocalArmPlanner

    requests = sys.stdin.buffer
    planner = LocalArmPlanner(pickle.load(requests))
    voice.say(READY)
    while True:
        ticket, request = pickle.load(requests)
        if ticket == KEEP_TREES:
            planner.keep_trees()
        else:
            voice.say(ticket, planner.answer(request))


def _beat(voice: Voice) -> None:
    """Tell again and again that this process works, and end it when nobody listens any more."""
    told_s = 0.0
    while True:
        time.sleep(BEAT_S)
        worked_s = time.process_time()
        # A process that waits for ever is silent.
        if worked_s - told_s >= WORK_S:
            told_s = worked_s
            try:
                voice.say(BEAT)
            except BrokenPipeError:
                os._exit(1)


if __name__ == "__main__":
    main()
