"""A fleet on the grid without arms and physics, fast enough to train on."""
