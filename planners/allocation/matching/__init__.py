"""Matching of few cheap pairs out of many, with proof that the others could not be cheaper."""
