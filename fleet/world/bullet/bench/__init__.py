"""Benches: single robots in the engine, beside any fleet."""
