"""Robots that are told a speed and a yaw rate: a skid-steered Husky, a trotting A1, and how they follow paths."""
