"""Fidelities as they are typed."""

from __future__ import annotations

from fleet.config import WHOLE, Fidelity, require

EVERY, EVERY_WHOLE = ",".join(Fidelity), ",".join(WHOLE)
"""All of them, and those of whole runs."""


def parse_fidelities(text: str) -> tuple[Fidelity, ...]:
    """Read the value of ``--fidelities``: names separated by commas, in their order.

    Raises:
        ConfigError: There is no such fidelity, or one stands twice.
    """
    names = [name.strip() for name in text.split(",")]
    for name in names:
        require(name in list(Fidelity), "--fidelities", name, ", ".join(Fidelity))
    require(len(set(names)) == len(names), "--fidelities", text, "each once")
    return tuple(map(Fidelity, names))
