"""Faults: what can go wrong, one class for each kind of event, with what ends it."""
