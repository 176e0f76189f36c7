"""Errors of the tabletop."""

from __future__ import annotations

from fleet.errors import FleetError


class TabletopError(FleetError):
    """A table cannot be laid as asked."""
