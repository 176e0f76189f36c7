"""Frames of the bridge: how messages go over the socket, both ways.

A frame is, one after the other,

    4 bytes   length of what follows, an unsigned integer, most significant byte first
    4 bytes   length of the header, the same
    header    a JSON object in UTF-8; `op` says what it is
    numbers   of the arrays that the header lists as `arrays`, `[[name, shape], ...]`: float64, little-endian, by rows
    bytes     whatever is left, such as an image

so that a client needs no more than a socket, JSON and an unpacking of floats. What messages there are stands in
`docs/guide/ros.md`.
"""

from __future__ import annotations

import json
import struct
from collections.abc import Iterator, Mapping

import numpy as np

from fleet.arrays import FloatArray
from fleet.errors import FleetError

FORMAT = 1
"""Changes when a client of before would misunderstand."""
MOST_BYTES = 1 << 20
"""Longest frame that is taken from a client."""
_LENGTHS = struct.Struct(">II")


class BadFrame(FleetError):
    """What came over the socket is no frame."""


def encoded(
    header: Mapping[str, object], arrays: Mapping[str, FloatArray] | None = None, content: bytes = b""
) -> bytes:
    """A frame.

    Args:
        header: What JSON can say, with an entry `op`.
        arrays: By name.
        content: Bytes that are no numbers.
    """
    parts = {name: np.ascontiguousarray(array, dtype="<f8") for name, array in (arrays or {}).items()}
    shapes = [[name, list(array.shape)] for name, array in parts.items()]
    head = json.dumps({**header, "arrays": shapes} if parts else header, separators=(",", ":")).encode()
    body = b"".join([*(array.tobytes() for array in parts.values()), content])
    return _LENGTHS.pack(4 + len(head) + len(body), len(head)) + head + body


def taken(buffer: bytearray) -> Iterator[dict[str, object]]:
    """Take the whole frames of a client from the front of a buffer; they have no arrays: lists of JSON will do.

    Raises:
        BadFrame: It is no frame, or too long.
    """
    while len(buffer) >= _LENGTHS.size:
        length, n_head = _LENGTHS.unpack_from(buffer)
        if not 4 + n_head <= length <= MOST_BYTES:
            raise BadFrame(f"frame of {length} bytes with a header of {n_head}; valid: up to {MOST_BYTES} bytes in all")
        if len(buffer) < 4 + length:
            return
        text = bytes(buffer[_LENGTHS.size : _LENGTHS.size + n_head])
        del buffer[: 4 + length]
        try:
            header = json.loads(text)
        except (UnicodeDecodeError, ValueError, RecursionError) as error:
            raise BadFrame(f"header {text[:40]!r}; valid: a JSON object") from error
        if not isinstance(header, dict) or not isinstance(header.get("op"), str):
            raise BadFrame(f"header {text[:40]!r}; valid: a JSON object with its op")
        yield header
