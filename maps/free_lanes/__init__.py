"""Free lanes: a layout on no grid becomes a lane graph whose cells are what cars keep each other out of."""
