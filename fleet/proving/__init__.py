"""Proving ground: robots by themselves, on a course, on the spot and in a table of figures with their sources."""
