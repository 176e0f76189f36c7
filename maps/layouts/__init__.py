"""Layouts: floors in the formats of other fleet managers, read and written as text."""
