"""Near: the valid word that somebody may have meant."""

from __future__ import annotations

import difflib
from collections.abc import Iterable


def hint(word: object, valid: Iterable[str]) -> str:
    """What messages add to a word that is not valid: ` (did you mean small?)`, or nothing where none is near."""
    near = difflib.get_close_matches(word, list(valid), n=1) if isinstance(word, str) else []
    return f" (did you mean {near[0]}?)" if near else ""
