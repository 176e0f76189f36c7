"""Cdr: messages in the encoding of ROS 2, made once, of which only times and numbers change."""

from __future__ import annotations

import struct
from collections.abc import Sequence

_HEAD = b"\x00\x01\x00\x00"
"""Plain CDR, little-endian."""
_NS_PER_S = 1_000_000_000


class CdrMessage:
    """One message, put together field by field in the order of its definition.

    What follows a text is aligned by where the text ends, so that a message whose texts stay keeps the places of its
    numbers: they are written over.

    Source: OMG, Extensible and Dynamic Topic Types 1.3, section 7.4.3 (plain CDR, version 1).
    """

    def __init__(self) -> None:
        self._bytes = bytearray()
        self._stamps: list[int] = []
        self._numbers: list[tuple[struct.Struct, int, int]] = []
        self.n_numbers = 0
        """How many numbers `encoded` takes."""

    def stamp(self) -> CdrMessage:
        """A time, the same at all places of the message."""
        self._align(4)
        self._stamps.append(len(self._bytes))
        self._bytes += bytes(8)
        return self

    def text(self, text: str) -> CdrMessage:
        """A text."""
        encoded = text.encode() + b"\x00"
        self.count(len(encoded))
        self._bytes += encoded
        return self

    def count(self, n: int) -> CdrMessage:
        """The length of a sequence, or any other uint32."""
        self._align(4)
        self._bytes += struct.pack("<I", n)
        return self

    def byte(self, value: int) -> CdrMessage:
        """A uint8."""
        self._bytes.append(value)
        return self

    def numbers(self, n: int) -> CdrMessage:
        """Numbers of 64 bits that change, n >= 1."""
        self._align(8)
        self._numbers.append((struct.Struct(f"<{n}d"), len(self._bytes), self.n_numbers))
        self._bytes += bytes(8 * n)
        self.n_numbers += n
        return self

    def zeros(self, n: int) -> CdrMessage:
        """Numbers of 64 bits that stay 0."""
        self._align(8)
        self._bytes += bytes(8 * n)
        return self

    def encoded(self, time_ns: int, numbers: Sequence[float] = ()) -> bytes:
        """The message with these values.

        Args:
            time_ns: For all its stamps.
            numbers: In the order in which they were put in, `n_numbers` of them.
        """
        seconds, nanoseconds = divmod(time_ns, _NS_PER_S)
        for place in self._stamps:
            struct.pack_into("<iI", self._bytes, place, seconds, nanoseconds)
        for group, place, first in self._numbers:
            group.pack_into(self._bytes, place, *numbers[first : first + group.size // 8])
        return _HEAD + self._bytes

    def _align(self, size: int) -> None:
        self._bytes += bytes(-len(self._bytes) % size)
