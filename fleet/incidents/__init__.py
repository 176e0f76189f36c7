"""Incidents: what goes wrong in a run, and how cars come back from it."""
