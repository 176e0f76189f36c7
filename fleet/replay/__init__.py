"""Replay: a run that was recorded is run again, as it was or with another end."""
