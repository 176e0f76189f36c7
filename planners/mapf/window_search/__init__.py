"""Search in a window: a plan that is kept, moved on with time, and improved a few agents at a time."""
