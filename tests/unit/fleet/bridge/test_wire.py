"""Frames: what the run writes the client's code reads, and what clients write comes in whole or is refused."""

import json
import struct

import numpy as np
import pytest

from fleet.bridge.wire import MOST_BYTES, BadFrame, encoded, taken


def said(text: bytes, length: int | None = None) -> bytes:
    return struct.pack(">II", 4 + len(text) if length is None else length, len(text)) + text


def test_a_frame_is_lengths_header_numbers_and_bytes() -> None:
    frame = encoded({"op": "state", "tick": 7}, {"q": np.array([[1.5, 2.0], [3.0, -4.0]])}, b"xyz")
    length, n_head = struct.unpack_from(">II", frame)
    head = json.loads(frame[8 : 8 + n_head])
    assert length == len(frame) - 4
    assert head == {"op": "state", "tick": 7, "arrays": [["q", [2, 2]]]}
    assert struct.unpack_from("<4d", frame, 8 + n_head) == (1.5, 2.0, 3.0, -4.0)
    assert frame[-3:] == b"xyz"


def test_headers_are_taken_when_they_are_whole() -> None:
    stream = said(b'{"op": "pause"}') + said(b'{"op": "drive", "speed_mps": 0.5}')
    buffer, found = bytearray(), []
    for byte in stream:
        buffer.append(byte)
        found += taken(buffer)
    assert [header["op"] for header in found] == ["pause", "drive"]
    assert not buffer


@pytest.mark.parametrize(
    ("frame", "words"),
    [
        (said(b"{}"), "with its op"),
        (said(b"[1]"), "with its op"),
        (said(b"\xff\xfe"), "a JSON object"),
        (said(b'{"op": 1}'), "with its op"),
        (said(b'{"op": "x"}', 3), "frame of 3 bytes"),
        (said(b'{"op": "x"}', MOST_BYTES + 1), "up to 1048576 bytes"),
        (b"GET / HTTP/1.1\r\n\r\n", "valid: up to"),
    ],
)
def test_what_is_no_frame_is_refused_by_name(frame: bytes, words: str) -> None:
    with pytest.raises(BadFrame, match=words):
        list(taken(bytearray(frame)))
