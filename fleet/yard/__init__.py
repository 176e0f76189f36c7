"""Yard: cars that deliver over a floor without lanes."""
