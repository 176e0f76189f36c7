"""Console: the process's own output, kept apart from what libraries print from C."""

from __future__ import annotations

import os
import signal
import sys


def own_output() -> None:
    """Give Python's streams private file descriptors and send descriptors 1 and 2 to nowhere.

    The physics engine and the planning library print from C to the descriptors; a command line tool's output must not
    contain that. Call once, before anything heavy is imported. Until the command line takes over, Ctrl-C just ends
    the process, instead of showing where among the imports it was.
    """
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, signal.SIG_DFL)
    sys.stdout.flush()
    sys.stderr.flush()
    nowhere = os.open(os.devnull, os.O_WRONLY)
    for name, number in (("stdout", 1), ("stderr", 2)):
        stream = getattr(sys, name)
        private = os.fdopen(os.dup(number), "w", encoding=stream.encoding, errors=stream.errors, buffering=1)
        setattr(sys, name, private)
        os.dup2(nowhere, number)
    os.close(nowhere)
