"""Utilities of the package without science: arrays, checks, files, seeds, progress, the version."""

__version__ = "0.4.0"
"""Defined here alone: pyproject.toml and the provenance of every result read it."""
