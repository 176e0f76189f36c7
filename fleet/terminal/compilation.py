"""Compilation: says that kernels are being compiled, which takes a minute, once after each change of them."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import TextIO

NOTICE = "compiling kernels: once after an installation or a change, up to a minute or two"


@contextmanager
def compilation_told(stream: TextIO) -> Iterator[None]:
    """Within this the first kernel that has to be compiled is told in one line; kernels that are kept say nothing.

    Args:
        stream: Where to say it.
    """
    from numba.core.event import Event, Listener, install_listener

    class Teller(Listener):
        """Hears of every compilation of the process."""

        told = False

        def on_start(self, event: Event) -> None:
            """Say it once."""
            if not self.told:
                self.told = True
                print(NOTICE, file=stream, flush=True)

        def on_end(self, event: Event) -> None:
            """Nothing to say."""

    with install_listener("numba:compile", Teller()):
        yield
