"""The League of 2026: actions take several ticks, robots are delayed, and an executor keeps the order of a plan."""
