"""Tabletop: arms that sort things on a table; layouts, work, and the loop that plays them in the engine."""
