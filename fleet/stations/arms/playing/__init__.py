"""Playing: arms move as it was planned."""
