"""Formats of Open-RMF: navigation graphs, and the building maps that they are made of."""
