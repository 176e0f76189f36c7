"""Evaluation: named scenarios, policies that play them, intervals, a table of baselines, and data sets."""
