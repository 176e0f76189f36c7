"""Traffic: plans are made anew, granted move by move, and driven."""
