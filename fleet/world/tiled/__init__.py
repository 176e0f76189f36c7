"""Physics on large floors: tiles, each with an engine of its own, in this process or in several."""
