"""Utilities of the package without science: arrays, checks, files, seeds, progress."""
