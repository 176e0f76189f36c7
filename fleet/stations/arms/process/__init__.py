"""Process: the process of its own in which arms are planned, and what speaks with it."""
