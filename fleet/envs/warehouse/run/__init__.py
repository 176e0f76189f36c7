"""Runs in which agents decide for some robots."""
