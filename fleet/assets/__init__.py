"""Robot descriptions of our own: URDF text with `$name` places that `fleet.robots` fills in."""
