"""A fleet in timesteps of a second, whose arms are the time that they take: to train on, and for a first look."""
