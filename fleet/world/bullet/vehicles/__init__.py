"""Robots by themselves in an engine: a bare floor, wheels that skid, legs that trot, robots that only stand."""
