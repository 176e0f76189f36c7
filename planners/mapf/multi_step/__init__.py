"""Priority inheritance with backtracking over several timesteps."""
