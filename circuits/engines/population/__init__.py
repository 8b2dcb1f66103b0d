"""Populations in place of cells: rates, with or without the noise of a finite number of cells."""
