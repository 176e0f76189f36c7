"""Agents steer cars to places."""
