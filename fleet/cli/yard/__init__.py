"""Commands of floors without lanes."""
