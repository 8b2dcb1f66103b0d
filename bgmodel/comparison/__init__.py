"""Comparison of a circuit with the abstract test, trial by trial."""
