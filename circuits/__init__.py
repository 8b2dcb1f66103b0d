"""Basal ganglia circuits: each one a readable table, run by interchangeable engines."""

from circuits.moved import MOVED, tell

tell(MOVED)
