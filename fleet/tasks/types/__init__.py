"""Task types: one file for each kind of order."""
