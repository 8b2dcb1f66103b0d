"""Theory of the table: cells' own laws, the noise of a finite number of cells, stability."""
