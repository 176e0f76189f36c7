"""A run for programs outside of it: a socket that tells what happens, and takes commands."""
