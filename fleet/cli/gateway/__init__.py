"""Commands of runs that others command."""
