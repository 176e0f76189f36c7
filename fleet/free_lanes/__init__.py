"""Free lanes: cars on the layout of another fleet manager, as it is."""
