"""Arms at their stations: transfers are planned, played, and kept apart."""
