"""Measurements that complement the tests: speed, tuning and scores."""

from pathlib import Path

OUT = Path(__file__).parent / "out"
"""Folder for tables and pictures."""
