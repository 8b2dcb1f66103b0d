"""Pairs of real taps of an edge: by how much was it turned?  Two halves, held out in turn."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from bgmodel.support.arrays import Array
from bgmodel.support.seeds import stream
from bgmodel.tactile.decoder import EDGE, train
from bgmodel.tactile.likelihood import Pool, fit_likelihood
from bgmodel.tactile.networks import wrapped
from bgmodel.tactile.recordings import read_taps
from bgmodel.tactile.task import Source

# A 40 mm tip spans about 122 px of the 128; only the scale of displacements depends on this.
MM_PER_PX = 0.33
TOLERANCE_DEG = 0.5
"""Largest distance of a pair's true difference from the requested one."""


def decoded_yaw(seed: int, recordings: Path) -> Array:
    """Train the decoder; return true and decoded yaw of other real taps, (taps, 2) degrees.

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
    """Split taps at random into two halves; tables of recordings are sorted by yaw."""
    order = stream(seed, "figR1", "halves").permutation(len(taps))
    return np.array_split(taps[order], 2)


def pairs(differences_deg: Sequence[float], taps: Array) -> list[Array]:
    """Return decoded differences of pairs of taps, one array per true difference, degrees."""
    true = wrapped(taps[None, :, 0] - taps[:, None, 0], 360)
    read = wrapped(taps[None, :, 1] - taps[:, None, 1], 360)
    other = ~np.eye(len(taps), dtype=bool)
    return [read[other & (np.abs(true - d) < TOLERANCE_DEG)] for d in differences_deg]


def sources(parts: list[Array], differences_deg: Sequence[float]) -> list[Source]:
    """Return the readings of each half of the taps, with likelihoods fitted on the other half.

    Parameters
    ----------
    parts : list of two arrays (taps, 2), degrees
        True and decoded yaw, as from ``halves``.
    differences_deg : sequence of float
        Difference of yaw of a pair under each hypothesis; 0 if the edge was not turned.
    """

    def from_pairs(pool: Pool) -> list[Array]:
        return pairs(differences_deg, pool[0])

    names = tuple(f"{difference:g}" for difference in differences_deg)
    made = []
    for scored, fitted in (parts, parts[::-1]):
        likelihood = fit_likelihood([fitted], from_pairs, (-180.0, 180.0))
        logs = [likelihood(x) for x in pairs(differences_deg, scored)]
        made.append(Source(logs, names, likelihood))
    return made
