"""Figure S1: are posteriors calibrated? Likelihood of single readings on held-out taps."""

from __future__ import annotations

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from bgmodel.learning.gap import fold_sources
from bgmodel.plots import reliability
from bgmodel.support.files import read_table, write_table
from bgmodel.tactile.likelihood import Density, calibration
from figures.common import Settings, key, letter, run, where

# Fitting a t density takes 50 ms, hence half of the usual folds.
FORMS = {"kde": Density(kind="kde"), "t": Density(kind="t", inner_folds=5)}
LOOKS = {"kde": ("kernel density", "C0", -0.008), "t": ("Student t density", "C1", 0.008)}
"""Label, colour and horizontal offset, so that marks do not overlap."""


def compute(settings: Settings, taps: Path, *, output: Path) -> None:
    """Compare stated and observed on the scored sixth of every fold."""
    table = read_table(taps)
    parts = []
    for form, density in FORMS.items():
        for period in settings.calibrated_mm:
            sources = fold_sources(table, period, density=density)
            values = np.concatenate([x for s in sources for x in s.log_likelihood])
            truth = np.concatenate(
                [np.full(len(x), i) for s in sources for i, x in enumerate(s.log_likelihood)]
            )
            # Pairs share taps, so intervals are over taps, of which there are far fewer.
            rows = calibration(values, truth)
            taps_scored = sum(int(np.sqrt(len(s.log_likelihood[1]))) for s in sources)
            rows["count"] *= 2 * taps_scored / rows["count"].sum()
            parts.append(rows.assign(form=form, period_mm=period))
    write_table(pd.concat(parts), output, seed=settings.seed, settings=settings)


def draw(settings: Settings, data: Path, *, output: Path) -> Figure:
    """Draw one panel per grating, with both densities."""
    table = read_table(data)
    shown = settings.calibrated_mm
    figure, axes = plt.subplots(1, len(shown), figsize=(7.2, 2.2), sharex=True, sharey=True)
    for ax, period in zip(axes, shown, strict=True):
        for form, (label, colour, aside) in LOOKS.items():
            here = where(table, period_mm=period, form=form)
            beside = here.assign(stated=here["stated"] + aside)
            reliability(ax, beside, color=colour, lw=0.9, label=label)
        letter(ax, f"{period:g} mm")
        ax.label_outer()
    diagonal = Line2D([], [], color="0.8", lw=0.8, label="observed as stated")
    key(figure, axes[0], more=[diagonal], ncols=3)
    return figure


if __name__ == "__main__":
    run(compute=compute, draw=draw)
