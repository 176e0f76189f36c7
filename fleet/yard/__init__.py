"""Yard: racecars that deliver over a floor without lanes."""
