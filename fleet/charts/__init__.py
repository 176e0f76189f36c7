"""Charts: a small drawing library, and the statistics that its pictures show."""
