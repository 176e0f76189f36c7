"""Shown: values as messages show them, whatever a file holds: in one line, and not too long."""

from __future__ import annotations

_LONGEST = 120
"""Characters of a value that a message shows."""


def shown(value: object) -> str:
    """A value as a message shows it: cut in its middle where it is long.

    So what is valid can still be found behind it, and a path keeps its name.
    """
    if isinstance(value, int) and value.bit_length() > 4 * _LONGEST:
        return f"an integer of {value.bit_length()} bits"
    try:
        text = ascii(value) if isinstance(value, str) and not value.isprintable() else repr(value)
    except (ValueError, RecursionError):  # there is such an integer in it, or it is nested too deeply
        return f"a {type(value).__name__}"
    if "\n" in text:  # as arrays have it
        text = " ".join(text.split())
    return text if len(text) <= _LONGEST else f"{text[: _LONGEST - 45]} ... {text[-40:]}"


def named(key: str) -> str:
    """A key as a message names it: as it stands in the file, or as `shown` where it is long or has odd signs."""
    return key if key.isprintable() and len(key) <= _LONGEST else shown(key)
