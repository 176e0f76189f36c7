"""Parcels: where they are, which slots they get, and how arms are told to move them."""
