"""The compiled walk of the multihypothesis test with unit gain, through all thresholds at once."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from bgmodel.support.compiling import compiled, inlined

FARTHEST = 6.0
"""Standard deviations of a step within which its largest log odds are drawn."""
TINY = 1e-300


@compiled
def walk(
    rng: Any, channels: Any, drift: Any, odds: Any, widths: Any, trials: Any, counts: Any
) -> None:
    """Add first passages to ``counts`` (parts, thresholds, 2, steps): wrong, correct decisions.

    Each channel accumulates noise of variance 1/2 per unit of time, and the first, the correct one,
    the drift too. Within a step the log odds of a channel are a Brownian bridge, whose maximum is
    drawn from its exact distribution given both ends. With two channels this is exact; with more,
    their variance within a step is taken to be that at its end. A path passes all thresholds,
    ``odds``, with its running maximum; path k belongs to part k % parts.
    """
    sums, before, after, share = (
        np.zeros(channels), np.zeros(channels), np.zeros(channels), np.zeros(channels),
    )  # fmt: skip
    for trial in range(trials):
        part, row, top = trial % counts.shape[0], 0, -math.log(channels - 1.0)
        sums[:], before[:] = 0.0, top
        for step in range(len(widths)):
            width = widths[step]
            for i in range(channels):
                sums[i] += math.sqrt(width / 2) * rng.standard_normal()
            sums[0] += drift * width
            _log_odds(sums, share, after)
            chosen = -1
            for i in range(channels):
                near = top - FARTHEST * math.sqrt(width)
                if before[i] > near or after[i] > near:
                    peak = _peak(rng, before[i], after[i], _variance(share, i) * width)
                    if peak > top:
                        chosen, top = i, peak
            before[:] = after
            while row < len(odds) and top >= odds[row]:
                counts[part, row, 1 if chosen == 0 else 0, step] += 1
                row += 1
            if row == len(odds):
                break


@inlined
def _log_odds(sums: Any, share: Any, after: Any) -> None:
    """Write the posterior and its log odds for each channel."""
    largest, total = sums.max(), 0.0
    for i in range(len(sums)):
        share[i] = math.exp(sums[i] - largest)
        total += share[i]
    for i in range(len(sums)):
        after[i] = sums[i] - largest - math.log(max(total - share[i], TINY))


@inlined
def _variance(share: Any, i: Any) -> Any:
    """Return the variance of a channel's log odds per unit of time.

    The derivative by its own sum is 1, by another one minus the posterior of that among the others.
    """
    rest, squares = 0.0, 0.0
    for j in range(len(share)):
        if j != i:
            rest += share[j]
            squares += share[j] ** 2
    return 0.5 * (1.0 + squares / max(rest, 1e-150) ** 2)


@inlined
def _peak(rng: Any, start: Any, end: Any, variance: Any) -> Any:
    """Draw the maximum of a Brownian bridge."""
    spread = -2 * variance * math.log(1.0 - rng.random())
    return (start + end + math.sqrt((end - start) ** 2 + spread)) / 2
