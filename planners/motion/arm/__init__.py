"""Arms as arrays: kinematics, inverse kinematics, shapes of links."""
