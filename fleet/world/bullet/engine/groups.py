"""Groups: which bodies the engine looks at together; each has a group, and a mask of the groups that it may touch."""

MOVING, FIXED, FLOOR = 1, 2, 128
"""`MOVING` is also the engine's own for what moves, `FIXED` that for what does not; the floor is in `FLOOR` too."""
WHEELS_MASK = FLOOR
"""Wheels touch nothing else: as spheres they stand out of the chassis by a centimetre."""
FIXED_MASK = ~(FIXED | FLOOR)
"""Fixed things touch neither one another nor the floor: pairs of them would be looked at."""
ALL = -1
BOTH_AGREE = 0
"""Mode in which two bodies are looked at if each one's mask has the other's group; else the engine asks one of them."""
