"""The trials of a fit: their cells, their sides and the window of their times."""
