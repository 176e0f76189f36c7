"""Manoeuvres of one car."""
