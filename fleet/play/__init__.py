"""Runs of the fleet in which policies, learned or scripted, take the place of its parts."""
