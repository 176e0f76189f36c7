"""Agents choose the next moves of cars."""
