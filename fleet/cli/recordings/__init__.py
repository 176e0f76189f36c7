"""Commands for recordings: look at them, picture them, make them whole."""
