"""Same or different on real taps of an edge: readings from pairs of taps, held out by halves."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from bgmodel.arrays import Array
from bgmodel.seeds import stream
from bgmodel.tactile.decoder import EDGE, train
from bgmodel.tactile.likelihood import Pool, fit_likelihood
from bgmodel.tactile.networks import wrapped
from bgmodel.tactile.recordings import read_taps
from bgmodel.tactile.task import Source

# A 40 mm tip spans about 122 px of the 128; only the scale of displacements hangs on it.
MM_PER_PX = 0.33
TOLERANCE_DEG = 0.5
"""How far the true difference of a pair may lie from the difference asked for."""


def decoded_yaw(seed: int, recordings: Path) -> Array:
    """Return true and read yaw of held-out real taps, (taps, 2) degrees; trains the decoder.

    Parameters
    ----------
    seed : int
        Of the training.
    recordings : Path
        Folder with ``csv_train`` and ``csv_val``.
    """
    taps = read_taps(recordings / "csv_train", mm_per_px=MM_PER_PX)
    decoder = train(taps, seed=seed, training=EDGE)
    held = read_taps(recordings / "csv_val", mm_per_px=MM_PER_PX, rest=taps.rest_mm)
    return np.stack([held.labels["yaw_deg"], decoder.decode(held)["edge_deg"]], axis=1)


def halves(seed: int, taps: Array) -> list[Array]:
    """Return two halves at random: tables of recordings are sorted by yaw."""
    order = stream(seed, "figR1", "halves").permutation(len(taps))
    return np.array_split(taps[order], 2)


def pairs(difference_deg: float, taps: Array) -> list[Array]:
    """Return decoded differences of real pairs: true difference about 0 (S1), or as given (S2)."""
    true = wrapped(taps[None, :, 0] - taps[:, None, 0], 360)
    read = wrapped(taps[None, :, 1] - taps[:, None, 1], 360)
    other = ~np.eye(len(taps), dtype=bool)
    return [read[other & (np.abs(true - d) < TOLERANCE_DEG)] for d in (0.0, difference_deg)]


def sources(parts: list[Array], difference_deg: float) -> list[Source]:
    """Return the readings of each half of the taps, with likelihoods fitted on the other half.

    Parameters
    ----------
    parts : list of two arrays (taps, 2), degrees
        True and read yaw, as from ``halves``.
    difference_deg : float
        Yaw difference of the two taps of a pair under S2.
    """

    def from_pairs(pool: Pool) -> list[Array]:
        return pairs(difference_deg, pool[0])

    made = []
    for scored, fitted in (parts, parts[::-1]):
        likelihood = fit_likelihood([fitted], from_pairs, (-180.0, 180.0))
        logs = [likelihood(x) for x in pairs(difference_deg, scored)]
        made.append(Source(logs, ("same", "different"), likelihood))
    return made
