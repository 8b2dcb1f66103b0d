"""The compiled count of stored trials on a grid of time and evidence."""

from __future__ import annotations

from typing import Any

from bgmodel.support.compiling import compiled, inlined


@compiled
def count(
    bins: Any, choice: Any, evidence: Any, share: Any, parts: Any, width: Any,
    decided: Any, never: Any,
) -> None:  # fmt: skip
    """Add trials to the counts ``decided`` and ``never`` of a grid; see ``crossings.Counts``.

    A trial is given at several settings, of weights ``share``. If its choice is the same at all of
    them, its time and evidence are interpolated; otherwise it is divided among them. ``width`` is
    that of a bin of evidence, sqrt(s).
    """
    settings, trials = bins.shape
    part = -1
    for trial in range(trials):
        part = part + 1 if part + 1 < len(parts) else 0
        if not parts[part]:
            continue
        same = True
        when, read = 0.0, 0.0
        for setting in range(settings):
            same = same and choice[setting, trial] == choice[0, trial]
            when += share[setting] * bins[setting, trial]
            read += share[setting] * evidence[setting, trial]
        if same:
            add(when, choice[0, trial], read / width, 1.0, decided, never)
        else:
            for setting in range(settings):
                add(
                    float(bins[setting, trial]), choice[setting, trial],
                    evidence[setting, trial] / width, share[setting], decided, never,
                )  # fmt: skip


@inlined
def add(when: Any, chosen: Any, read: Any, weight: Any, decided: Any, never: Any) -> None:
    """Add one trial, or part of one, to the counts."""
    read = -read if chosen == 1 else read
    if chosen < 0:
        place = never.shape[0] // 2 + read
        left = int(place)  # the central column is far above 0
        right = weight * (place - left)
        never[left] += weight - right
        never[left + 1] += right
    else:
        place = decided.shape[2] // 2 + read
        left, low = int(place), int(when)
        side = chosen if decided.shape[0] == 2 else 0
        right = weight * (place - left)
        later = when - low
        decided[side, low, left] += (1 - later) * (weight - right)
        decided[side, low, left + 1] += (1 - later) * right
        if later > 0:
            decided[side, low + 1, left] += later * (weight - right)
            decided[side, low + 1, left + 1] += later * right
