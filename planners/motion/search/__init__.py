"""Searches for free paths in joint space."""
