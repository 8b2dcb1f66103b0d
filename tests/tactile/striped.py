"""Taps made up: easy to read, quick to make."""

import numpy as np
import pandas as pd

from bgmodel.support.seeds import stream
from bgmodel.tactile.decoder import Training
from bgmodel.tactile.skin import Tip
from bgmodel.tactile.taps import Taps

QUICK = Training(width=0.1, epochs=3, validation=0.2)


def striped_taps(count=400, seed=1, layout="square", limit=90):
    """Taps whose displacements are plain stripes across the yaw."""
    rng = stream(seed, "striped")
    rest = Tip(layout=layout).rest_mm()
    yaw = rng.uniform(-limit, limit, count)
    across = np.cos(np.radians(yaw))[:, None] * rest[:, 0]
    across = across + np.sin(np.radians(yaw))[:, None] * rest[:, 1]
    size = 1 + np.sin(2 * np.pi * across / 6 + rng.uniform(0, 7, count)[:, None])
    moved = np.stack([size, 0 * size], axis=-1) + rng.normal(0, 0.1, (count, len(rest), 2))
    return Taps(moved.astype(np.float32), rest, pd.DataFrame({"yaw_deg": yaw}))


def pushed_taps(count, seed):
    """Taps of an edge, with displacements towards the side that the edge is on."""
    taps = striped_taps(count, seed, "circular", 180)
    yaw = np.radians(taps.labels["yaw_deg"].to_numpy())
    side = np.stack([np.cos(yaw), np.sin(yaw)], axis=-1)[:, None]
    noise = stream(seed, "noise").normal(0, 1.0, taps.displacement_mm.shape)
    return Taps((side + noise).astype(np.float32), taps.rest_mm, taps.labels, "edge")
