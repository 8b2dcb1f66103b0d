"""The table of figures 4a and 4b: every gap on every grating, on six folds of held-out taps."""

from __future__ import annotations

from pathlib import Path

import pandas as pd

from bgmodel.learning.gap import fold_sources, search_folds
from bgmodel.support.files import read_table, write_table
from figures.common import Settings


def compute(settings: Settings, taps: Path, *, output: Path) -> None:
    """Score every gap by simulation and exactly."""
    table = read_table(taps)
    parts = []
    for period in settings.periods_mm:
        sources = fold_sources(table, period)
        scored = search_folds(
            sources,
            settings.separations,
            trials=settings.sweep_trials,
            t_max=settings.t_max,
            seed=settings.seed,
            name=period,
        )
        shrink = {fold: source.likelihood.shrink for fold, source in enumerate(sources)}
        parts.append(scored.assign(period_mm=period, shrink=scored["fold"].map(shrink)))
    write_table(pd.concat(parts), output, seed=settings.seed, settings=settings)
