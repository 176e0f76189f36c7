"""Interrupts: Ctrl-C that ends a run between two steps instead of in the middle of one."""

from __future__ import annotations

import signal
import sys
import threading
import traceback
from collections.abc import Iterator
from contextlib import contextmanager

_AGAIN_S = 0.01
"""Until a lost interrupt is raised again: by then the destructor has ended [s]."""


@contextmanager
def interrupts() -> Iterator[list[int]]:
    """Collect SIGINT and SIGTERM in a list instead of raising in the middle of a step; a second one raises."""
    seen: list[int] = []

    def handler(number: int, frame: object) -> None:
        del frame
        if seen:
            raise KeyboardInterrupt
        seen.append(number)

    try:
        before = {number: signal.signal(number, handler) for number in (signal.SIGINT, signal.SIGTERM)}
    except ValueError:  # not in the main thread: the caller keeps its own handling
        yield seen
        return
    try:
        yield seen
    finally:
        for number, old in before.items():
            signal.signal(number, old)


@contextmanager
def interrupts_kept() -> Iterator[None]:
    """Within this an interrupt that was lost is raised again, until it arrives.

    What is raised in a destructor is lost, and a run would go on. Kernels that are compiled or read from their cache
    leave many objects with destructors behind.
    """
    complain = sys.unraisablehook
    again: list[threading.Timer] = []
    main = threading.main_thread().ident

    def raise_again() -> None:
        if main is not None:
            signal.pthread_kill(main, signal.SIGINT)  # a signal also wakes what sleeps or waits

    def hear(unraisable: sys.UnraisableHookArgs) -> None:
        if not issubclass(unraisable.exc_type, KeyboardInterrupt):
            complain(unraisable)
            return
        again.append(threading.Timer(_AGAIN_S, raise_again))
        again[-1].daemon = True
        again[-1].start()

    sys.unraisablehook = hear
    try:
        yield
    finally:
        for timer in again:
            timer.cancel()
        sys.unraisablehook = complain


def discard(interrupt: KeyboardInterrupt) -> None:
    """Free what was under way; what is half made, as the compiler's objects may be, complains of that to nobody."""
    complain, sys.unraisablehook = sys.unraisablehook, lambda unraisable: None
    traceback.clear_frames(interrupt.__traceback__)
    sys.unraisablehook = complain
