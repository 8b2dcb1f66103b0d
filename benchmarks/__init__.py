"""Measurements that complement the tests: speed, tuning and scores."""

import os
from pathlib import Path

OUT = Path(os.environ.get("BENCHMARKS_OUT") or Path(__file__).parent / "out")
"""Folder for tables and pictures: another one where the environment names it."""
