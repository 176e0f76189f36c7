"""LaCAM, its search tree, and the large neighbourhood search that shortens what it finds."""
