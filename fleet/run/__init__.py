"""A run: what it starts from, its clock and its events, and the one view that observers have of it."""
