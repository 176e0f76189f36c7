"""Dispatch: which car gets which task, and what happens in which order."""
