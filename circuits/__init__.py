"""Basal ganglia circuits: each is a readable table that interchangeable engines can run."""

DEFAULT = "macaque"
"""Name of the default circuit."""
