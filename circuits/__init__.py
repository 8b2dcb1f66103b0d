"""Basal ganglia circuits: each one a readable table, run by interchangeable engines."""
