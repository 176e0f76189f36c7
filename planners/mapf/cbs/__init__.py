"""Conflict-based search."""
