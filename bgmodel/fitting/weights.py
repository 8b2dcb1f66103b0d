"""The compiled sum over stored trials."""

from __future__ import annotations

import math
from typing import Any

from bgmodel.compiling import compiled


@compiled
def between(
    bins: Any, choice: Any, evidence: Any, log_mixture: Any, share: Any,
    place: Any, chosen: Any, read: Any, weight: Any,
) -> Any:  # fmt: skip
    """Fill in what trials do between neighbouring settings; return how many rows that takes.

    A trial is given at several settings, as at two thresholds between which the asked one lies.
    Where it chose the same at all of them, it decides between them in time, having read what lies
    between; where not, it is divided among them.

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
    place, chosen, read, weight : array (settings * trials,)
        Filled, a row for each trial or part of one: bin, choice, X, and the log of its weight
        without drift.
    """
    settings, trials = bins.shape
    rows = 0
    for trial in range(trials):
        same = True
        for setting in range(1, settings):
            same = same and choice[setting, trial] == choice[0, trial]
        if same:
            when, seen, mixture = 0.0, 0.0, 0.0
            for setting in range(settings):
                when += share[setting] * bins[setting, trial]
                seen += share[setting] * evidence[setting, trial]
                mixture += share[setting] * log_mixture[setting, trial]
            place[rows], chosen[rows], read[rows] = when, choice[0, trial], seen
            weight[rows] = -mixture
            rows += 1
        else:
            for setting in range(settings):
                place[rows], chosen[rows] = bins[setting, trial], choice[setting, trial]
                read[rows] = evidence[setting, trial]
                weight[rows] = math.log(share[setting]) - log_mixture[setting, trial]
                rows += 1
    return rows


@compiled
def gather(place: Any, chosen: Any, as_zero: Any, as_one: Any, found: Any) -> None:
    """Add trials to ``found`` (drifts, 2, bins), and bring its sums over all of them to 1.

    Parameters
    ----------
    place : array (rows,)
        Bin of the decision; between two bins it goes to both.
    chosen : int array (rows,)
        0 or 1, -1 where there was none.
    as_zero, as_one : array (drifts, rows)
        What a row weighs if the drift speaks for 0, and for 1. Drift speaks for 1: a stored trial
        is one of channel 0, and its mirror image one of channel 1.
    found : array (drifts, 2, bins)
        What is added to; a decision beyond the last bin counts to the whole alone.
    """
    last = found.shape[2] - 1
    for cell in range(found.shape[0]):
        whole = 0.0
        for row in range(len(place)):
            one, zero = as_one[cell, row], as_zero[cell, row]
            whole += one + zero
            low = int(place[row])
            if chosen[row] < 0 or low > last:
                continue
            toward = place[row] - low
            for side in range(2):
                if low + side <= last:
                    part = toward if side else 1 - toward
                    found[cell, 1 - chosen[row], low + side] += part * one
                    found[cell, chosen[row], low + side] += part * zero
        found[cell] /= whole
