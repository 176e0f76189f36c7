"""Safety: what must hold after every tick of a run, judged by a referee that shares no code with what it judges."""
