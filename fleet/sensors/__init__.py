"""Sensors: cameras with their images, and what can be told from an image; plain arrays, no engine."""
