"""Basal ganglia circuits: each one a readable table, run by interchangeable engines."""

DEFAULT = "macaque"
"""Name of the circuit that runs where none is named."""
