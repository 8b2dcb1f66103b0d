"""The compiled sum over stored trials."""

from __future__ import annotations

import math
from typing import Any

from bgmodel.compiling import compiled


@compiled
def weigh(
    bins: Any, choice: Any, evidence: Any, log_mixture: Any,
    share: Any, bin_s: float, drift: Any, found: Any,
) -> None:  # fmt: skip
    """Add to ``found`` (drifts, 2, bins) what every stored trial and its image stand for.

    A trial is given at several neighbouring settings, as at two thresholds between which the
    asked one lies. Where it chose the same at all of them, it decides between them in time, having
    read what lies between; where not, it is divided among them.

    Parameters
    ----------
    bins : int array (settings, trials)
        Bin of the decision, the last one where there was none.
    choice : int array (settings, trials)
        0 or 1, -1 where there was none.
    evidence, log_mixture : array (settings, trials)
        As of ``Crossings``.
    share : array (settings,)
        How near the asked setting lies to each; they sum to 1.
    bin_s : float, s
        Width of a bin.
    drift : array (drifts,), 1/sqrt(s)
        In favour of response 1.
    found : array (drifts, 2, bins)
        What is added to; a decision beyond the last bin counts to the whole alone. Its sums over
        all trials are brought to 1, which is what they are but for chance.
    """
    settings, trials = bins.shape
    for cell in range(len(drift)):
        v, whole = drift[cell], 0.0
        for trial in range(trials):
            same = True
            for setting in range(1, settings):
                same = same and choice[setting, trial] == choice[0, trial]
            if same:
                place, read, mixture = 0.0, 0.0, 0.0
                for setting in range(settings):
                    place += share[setting] * bins[setting, trial]
                    read += share[setting] * evidence[setting, trial]
                    mixture += share[setting] * log_mixture[setting, trial]
                whole += _add(found[cell], v, place, choice[0, trial], read, mixture, 1.0, bin_s)
            else:
                for setting in range(settings):
                    whole += _add(
                        found[cell], v, float(bins[setting, trial]), choice[setting, trial],
                        evidence[setting, trial], log_mixture[setting, trial], share[setting],
                        bin_s,
                    )  # fmt: skip
        found[cell] /= whole


@compiled
def _add(
    found: Any, v: float, place: float, choice: int, read: float, mixture: float, share: float,
    bin_s: float,
) -> float:  # fmt: skip
    """Add one trial, of which the drift may speak for either channel; return what it weighs."""
    common = -v * v * (place + 1) * bin_s / 2 - mixture
    # Drift speaks for 1: a stored trial is one of channel 0, and its mirror image of channel 1.
    as_one, as_zero = share * math.exp(common + v * read), share * math.exp(common - v * read)
    low = int(place)
    toward = place - low
    if choice >= 0 and low < found.shape[1]:
        found[1 - choice, low] += (1 - toward) * as_one
        found[choice, low] += (1 - toward) * as_zero
        if low + 1 < found.shape[1]:
            found[1 - choice, low + 1] += toward * as_one
            found[choice, low + 1] += toward * as_zero
    return as_one + as_zero
