"""Worker: the process of its own in which arms are planned."""
