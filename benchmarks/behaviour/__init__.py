"""Behaviour: what sixty runs do, tick by tick, is recorded, so that changes of the code can be compared bit for bit."""
