"""Safe interval path planning, one agent after another."""
