"""Figure 5b: sampled rewards of all gaps, their average, the exact curve and the learned value."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from bgmodel import Sprt, stream
from bgmodel.deciding.decision import crossing_of_each
from bgmodel.deciding.reward import reward, reward_of
from bgmodel.learning.gap import fold_sources, search_folds
from bgmodel.support.files import read_table, write_table
from figures.common import COLOUR, Settings, letter

DOTS = 1500


def search(settings: Settings, taps: Path, *, output: Path) -> None:
    """Search all gaps on 1.4e6 trials per grating, a sixth of them on each fold."""
    table = read_table(taps)
    parts = []
    for period in COLOUR:
        scored = search_folds(
            fold_sources(table, period),
            settings.separations,
            trials=settings.search_trials // 6,
            t_max=settings.t_max,
            seed=settings.seed,
            name=("fig5b", period),
        )
        parts.append(scored.assign(period_mm=period))
    write_table(pd.concat(parts), output, seed=settings.seed, settings=settings)


def dots(settings: Settings, taps: Path, *, output: Path) -> None:
    """Draw single trials, each with a different gap, for the cloud of sampled rewards."""
    table = read_table(taps)
    parts = []
    for period in COLOUR:
        rng = stream(settings.seed, "dots", period)
        evidence = fold_sources(table, period)[0].draw(DOTS, settings.t_max, rng=rng)
        gaps = rng.uniform(0, 8, DOTS)
        decision = crossing_of_each(Sprt().run(evidence), Sprt.threshold(gaps), checked=False)
        assert evidence.truth is not None
        rewards = reward(decision, evidence.truth, settings.xi)
        parts.append(
            pd.DataFrame({"period_mm": period, "boundary_separation": gaps, "reward": rewards})
        )
    write_table(pd.concat(parts), output, seed=settings.seed, settings=settings)


def draw(
    settings: Settings, searched: Path, dotted: Path, learned: Path, *, output: Path
) -> Figure:
    """Draw one panel per grating."""
    tables = [read_table(path) for path in (searched, dotted, learned)]
    figure, axes = plt.subplots(2, 3, figsize=(7.2, 3.8), sharex=True, height_ratios=[1, 1.2])
    for column, period in enumerate(COLOUR):
        curve, cloud, values = (t[t["period_mm"] == period] for t in tables)
        colour = COLOUR[period]
        for ax in axes[:, column]:
            _curves(ax, curve, settings.xi, colour)
            _learned(ax, values)
        axes[0, column].plot(
            cloud["boundary_separation"], cloud["reward"], ".", ms=1, color="0.75", zorder=0
        )
        best = -_exact_costs(curve, settings.xi)
        span = max(0.15, 0.6 * (best.max() - best.min()))
        axes[1, column].set_ylim(best.max() - span, best.max() + 0.12 * span)
        axes[1, column].set_xlabel("boundary separation δ (nats)")
        letter(axes[0, column], f"{period:g} mm")
    axes[0, 0].set_ylabel("reward of a trial\n(readings)")
    axes[1, 0].set_ylabel("mean reward,\nenlarged (readings)")
    figure.legend(handles=_key(), loc="outside lower center", ncols=5, columnspacing=1.4)
    return figure


def _key() -> list[Any]:
    """Return the marks of all panels, in neutral colours."""
    return [
        Line2D([], [], ls="", marker=".", ms=3, color="0.75", label="reward of one trial"),
        Line2D([], [], lw=2.2, alpha=0.5, color="0.3", label="mean of sampled trials"),
        Line2D([], [], lw=0.8, ls=":", color="k", label="exact mean"),
        Line2D([], [], lw=1, color="0.2", label="learned gap, mean of runs"),
        Patch(color="0.5", alpha=0.15, lw=0, label="10-90 % of runs"),
    ]


def _exact_costs(curve: pd.DataFrame, xi: float) -> pd.Series[float]:
    """Return the exact mean cost at each gap."""
    costs = -reward_of(1 - curve["exact_accuracy"], curve["exact_mean_steps"], xi)
    return pd.Series(costs, curve.index).groupby(curve["boundary_separation"]).mean()


def _curves(ax: Axes, curve: pd.DataFrame, xi: float, colour: str) -> None:
    sampled = reward_of(1 - curve["accuracy"], curve["mean_steps"], xi)
    mean = pd.Series(sampled, curve.index).groupby(curve["boundary_separation"]).mean()
    ax.plot(mean.index, mean, color=colour, lw=2.2, alpha=0.5)
    exact = _exact_costs(curve, xi)
    ax.plot(exact.index, -exact, color="k", lw=0.8, ls=":")


def _learned(ax: Axes, values: pd.DataFrame) -> None:
    final = values.groupby(["start_separation", "fold", "repeat"])["learned_separation"].first()
    ax.axvline(final.mean(), color="0.2", lw=1)
    ax.axvspan(*np.percentile(final, [10, 90]), color="0.5", alpha=0.15, lw=0)
