"""Scheduling of tasks as a job shop with travel."""
