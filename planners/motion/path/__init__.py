"""Paths and trajectories: tool lines, routes, time stamps."""
