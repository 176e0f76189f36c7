"""Commands about policies: they are trained, evaluated, played, and what they do is kept."""
