"""One script a figure: compute a tidy table, then draw it."""
