"""Missions: what every car and station is about, and the rules that decide what comes next for each."""
