"""Measurements beside the tests: speed, tuning and scores."""

from pathlib import Path

OUT = Path(__file__).parent / "out"
"""Where tables and pictures go."""
