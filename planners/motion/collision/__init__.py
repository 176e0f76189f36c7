"""Collision checks of an arm against boxes and itself."""
