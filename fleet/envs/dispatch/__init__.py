"""Agents choose tasks for cars."""
