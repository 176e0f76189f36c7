"""Size and turning circle of the car the lanes are laid out for, measured from the centre of its rear axle.

Source: the PyBullet racecar (wheelbase 0.325 m); a pure-pursuit controller follows arcs of 0.4 m radius within 4 cm.
"""

BODY_FRONT_M = 0.41
"""Reach of the body ahead of the rear axle [m]."""
TRAY_AHEAD_M = 0.16
"""Centre of the tray ahead of the rear axle [m]."""
TURN_RADIUS_M = 0.4
"""Radius of the rear axle's arc in a left or right move [m]."""
ENTRY_INSET_M = 0.1
"""Where a car waits: rear axle this far inside the entry side of its cell [m], so that its tail is inside too."""
