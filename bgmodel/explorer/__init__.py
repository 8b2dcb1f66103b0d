"""The interactive explorer: edit a circuit, and see it fire, decide and behave."""
