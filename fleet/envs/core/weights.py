"""Weights of rewards: checked where they are made and where they are taken."""

from __future__ import annotations

from dataclasses import fields
from typing import TYPE_CHECKING

from fleet.config import require
from fleet.config.field_checks import is_number

if TYPE_CHECKING:
    from _typeshed import DataclassInstance


def check_weights(weights: DataclassInstance) -> None:
    """Refuse weights that are no finite numbers.

    Raises:
        ConfigError: Which one, and its value.
    """
    for field in fields(weights):
        value = getattr(weights, field.name)
        require(is_number(value), f"weight {field.name}", value, "a number")


def require_weights(weights: object, kind: type) -> None:
    """Refuse what are no weights of this kind.

    Raises:
        ConfigError: It is neither None nor of that kind.
    """
    valid = f"a {kind.__module__}.{kind.__name__}, or None"
    require(weights is None or isinstance(weights, kind), "weights", weights, valid)
