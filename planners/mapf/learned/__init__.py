"""Moves scored by a small learned network, carried out by PIBT."""
