"""Real taps of an edge: train a decoder on one part of a recording, test it on another."""

from __future__ import annotations

from pathlib import Path

import pandas as pd

from bgmodel.tactile.decoder import EDGE, train
from bgmodel.tactile.recordings import read_taps

# A 40 mm tip spans about 122 px of the 128; only the scale of displacements depends on this.
MM_PER_PX = 0.33


def decoded_edges(seed: int, recordings: Path) -> pd.DataFrame:
    """Train on ``csv_train``; return true and decoded yaw (yaw_deg, edge_deg) of ``csv_val``."""
    taps = read_taps(recordings / "csv_train", mm_per_px=MM_PER_PX)
    decoder = train(taps, seed=seed, training=EDGE)
    held = read_taps(recordings / "csv_val", mm_per_px=MM_PER_PX, rest=taps.rest_mm)
    return decoder.decode(held)[["yaw_deg", "edge_deg"]]
