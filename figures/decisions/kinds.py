"""Kinds of evidence on which the default circuit is compared with the MSPRT.

Gaussian readings, taps of gratings and, if recordings are available, of an edge. Simulated taps
come from six folds, and their intervals are over folds.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from functools import cache, partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from bgmodel import stream
from bgmodel.evidence import Evidence
from bgmodel.simulated_evidence import separated_evidence
from bgmodel.tactile.source import FOLDS, Folds, Source, Tactile, folds, held_out_taps
from bgmodel.tactile.task import EdgeTurn, Orientation, SameDifferent

SCORING_SEED = 40_001
Draw = Callable[..., Evidence]


class Kind(NamedTuple):
    """A kind of evidence: alternatives, most readings, drawing, CPU seconds per 100 trials."""

    name: str
    channels: int
    most: int
    draw: Draw
    seconds: float


def gaussian(hypotheses: int, d_prime: float) -> Draw:
    """Return a function that draws Gaussian evidence of a pairwise d' per reading."""
    return partial(separated_evidence, separation=d_prime / np.sqrt(2), hypotheses=hypotheses)


def kinds() -> Iterator[Kind]:
    """Yield the kinds of evidence."""
    gaussians = ((2, 0.5, 120, 3), (4, 0.5, 120, 7), (2, 1, 40, 1.5), (4, 1, 40, 2.5))
    for count, d_prime, most, seconds in (*gaussians, (8, 0.5, 160, 16)):
        name = f"Gaussian, d' {d_prime:g}, N = {count}"
        yield Kind(name, count, most, gaussian(count, d_prime), seconds)
    for period, most, seconds in ((1.5, 240, 4), (2.0, 40, 1)):
        draw = partial(read, partial(gratings, SameDifferent(period)))
        yield Kind(f"same/different, {period:g} mm", 2, most, draw, seconds)
    for count, seconds in ((4, 2), (8, 7)):
        draw = partial(read, partial(gratings, Orientation(count)))
        yield Kind(f"{count} orientations, 2 mm", count, 60, draw, seconds)
    if folder := os.environ.get("BGMODEL_RECORDINGS"):
        draw = partial(read, partial(real_taps, Path(folder)))
        yield Kind("real taps, edge 5 degrees", 2, 60, draw, 1.5)


def read(source: Callable[[], Source | Folds], *arguments: Any, **named: Any) -> Evidence:
    """Draw evidence from a source that is created on first use."""
    return source().draw(*arguments, **named)


@cache
def gratings(question: Tactile) -> Folds:
    """Return readings of held-out taps of a grating, of all folds."""
    return folds(held_out_taps(), question)


@cache
def real_taps(folder: Path) -> Folds:
    """Return readings of pairs of real taps of an edge, of all folds."""
    from bgmodel.tactile.source import decoded_edges

    return folds(decoded_edges(SCORING_SEED, folder), EdgeTurn(2, step_deg=5.0))


def drawn(kind: Kind, trials: int, step_ms: float) -> Evidence:
    """Return evidence of a kind, the same for every circuit."""
    rng = stream(SCORING_SEED, "scoring", kind.name)
    return kind.draw(trials, kind.most, rng=rng, step_ms=step_ms)


def groups_of(name: str, trials: int) -> npt.NDArray[np.intp] | None:
    """Return the fold of each trial of taps; intervals resample whole folds."""
    tapped = name.startswith(("same/different", "4 orient", "8 orient", "real taps"))
    return np.arange(trials) % FOLDS if tapped else None
