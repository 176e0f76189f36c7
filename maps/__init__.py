"""Floor maps, sites and lane graphs: pure data, no state, no I/O beyond site and map files."""
