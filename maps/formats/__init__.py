"""Formats: maps and problems as others publish them."""
