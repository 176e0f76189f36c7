"""The physics engine: its connection, settings, windows and frames."""
