"""Fits to many people at once: each has parameters drawn from a distribution of the group."""
