"""Rates of populations instead of cells, with or without the noise of finitely many cells."""
