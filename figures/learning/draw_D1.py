"""Figure D1: reward learning of the trade-off, by the algorithm's gap and by dopamine.

The same learner with two models. In the algorithm its action is the gap of an SPRT; in the circuit
it is a dopamine level, without access to a gap, posterior or test. Rate circuits and populations
with noise learn; the levels learned by the latter are scored in spikes.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from bgmodel import stream
from bgmodel.integrators.basal_ganglia import BasalGanglia
from bgmodel.integrators.criterion import gain_of
from bgmodel.learning.dopamine import playable_levels
from bgmodel.learning.dopamine_learner import learn_level, level_outcomes, scored_runs
from bgmodel.learning.reinforce import Learner, LevelOutcomes, smoothed
from bgmodel.support.files import read_table, write_table
from bgmodel.tactile.source import source
from bgmodel.tactile.task import SameDifferent
from circuits.anatomy import DEFAULT, load_circuit
from circuits.engines import Engine, Populations, Rates, Spikes
from figures.common import BRIEF_MS, COLOUR, Settings, key, letter

STEP_MS = 50.0
STARTS = (1, -2)
"""Initial levels of tonic dopamine: too cautious, too hasty."""
TRIALS = 3.0
"""Trials of a circuit, as a fraction of those of the other circuit figures."""
SPIKING_TRIALS = {1.5: 0.75, 2.0: 2.0}
"""The same in spikes: at 2 mm trials are shorter, and errors so rare that more are needed."""
LEVELS, SCORED = 16, 4
"""Levels to choose from; quantiles of the learned levels scored in spikes, in addition to the
initial and the best ones."""
RUNS = 20
KEPT = 120
COLUMNS = ["run", "learned_level", "regret", "period_mm"]
COLUMNS += ["start_level", "best_level", "best_reward", "start_regret"]
PERIODS = {"rate": (1.5, 2.0, 2.5), "population": (1.5, 2.0)}


def rate(settings: Settings, taps: Path, *, output: Path) -> None:
    """Learn dopamine in the rate circuit."""
    _learn(settings, taps, Rates().coarse(), output)


def population(settings: Settings, taps: Path, *, output: Path) -> None:
    """Learn dopamine in the circuit with the noise of its cells."""
    _learn(settings, taps, Populations(settle_ms=BRIEF_MS), output)


def spikes(settings: Settings, taps: Path, learned: Path, *, output: Path) -> None:
    """Score the levels learned by populations in spikes, on fresh evidence."""
    model = _model(settings, Spikes(settle_ms=BRIEF_MS))
    model = replace(model, seed=settings.seed + 1)
    parts = []
    period: Any
    start: Any
    for period, runs in read_table(learned).groupby("period_mm"):
        ends = runs.drop_duplicates(["start_level", "run"])
        at = [*ends["start_level"], ends["best_level"].iloc[0], *ends["learned_level"]]
        levels = np.quantile(at, np.linspace(0, 1, SCORED))
        levels = np.unique([*levels, *ends["start_level"], ends["best_level"].iloc[0]])
        fresh = _outcomes(settings, taps, model, float(period), "scored", levels)
        for start, of_start in ends.groupby("start_level"):
            given: dict[str, Any] = {"xi": settings.xi, "start_level": float(start)}
            found = scored_runs(of_start["learned_level"], fresh, **given)
            parts.append(found.assign(period_mm=period)[COLUMNS])
    write_table(pd.concat(parts), output, seed=settings.seed, settings=settings)


def _model(settings: Settings, engine: Engine) -> BasalGanglia:
    table = load_circuit(DEFAULT)
    return BasalGanglia(table, engine, gain_of(table), settings.seed)


def _outcomes(
    settings: Settings,
    taps: Path,
    model: BasalGanglia,
    period: float,
    name: str,
    levels: np.ndarray,
) -> LevelOutcomes:
    """Return the outcomes of each level on separate evidence, for learning or for scoring."""
    drawn = source(read_table(taps), SameDifferent(period_mm=period), fold=0).draw
    rng = stream(settings.seed, "figD1", name, period)
    share = SPIKING_TRIALS[period] if model.engine.spiking else TRIALS
    trials = round(share * settings.circuit_trials)
    return level_outcomes(model, drawn(trials, settings.t_max, rng=rng, step_ms=STEP_MS), levels)


def _learn(settings: Settings, taps: Path, engine: Engine, output: Path) -> None:
    model = _model(settings, engine)
    levels = playable_levels(model, LEVELS)
    parts = []
    for period in PERIODS[engine.id]:
        # Scoring also uses separate noise.
        outcomes, fresh = (
            _outcomes(settings, taps, replace(model, seed=seed), period, name, levels)
            for name, seed in (("learned", settings.seed), ("scored", settings.seed + 1))
        )
        for start in levels[list(STARTS)].tolist():
            learned = learn_level(
                outcomes,
                xi=settings.xi,
                start_level=start,
                runs=RUNS,
                seed=settings.seed,
                name=(engine.id, period),
                learner=Learner(episodes=settings.episodes),
            )
            at = np.linspace(0, settings.episodes - 1, KEPT).round().astype(int)
            curves = smoothed(learned.mean_played, 500)[:, at]
            runs = scored_runs(learned.learned, fresh, xi=settings.xi, start_level=start)
            runs = runs.assign(period_mm=period)[COLUMNS]
            kept = runs.loc[runs.index.repeat(KEPT)]
            parts.append(kept.assign(episode=np.tile(at, RUNS), level=curves.ravel()))
    write_table(pd.concat(parts), output, seed=settings.seed, settings=settings)


def draw(
    settings: Settings, gap: Path, rates: Path, noisy: Path, spiking: Path, *, output: Path
) -> Figure:
    """Draw the course of learning, trial by trial, and the final cost."""
    figure, axes = plt.subplots(1, 4, figsize=(7.4, 2.9), width_ratios=[1, 1, 1, 0.9])
    algorithm = read_table(gap)
    # The circuits received the readings of one fold.
    algorithm = algorithm[algorithm["fold"] == 0]
    _gap(axes[0], algorithm)
    _levels(axes[1], read_table(rates))
    letter(axes[1], "b  circuit, rates")
    _levels(axes[2], read_table(noisy))
    letter(axes[2], "c  circuit, noise")
    _regret(axes[3], algorithm, *map(read_table, (rates, noisy, spiking)))
    key(figure, axes[0], more=_marks(), ncols=4)
    return figure


def _marks() -> list[Line2D]:
    """Return the marks that do not depend on the grating."""
    black: dict[str, Any] = {"color": "k", "lw": 0.8}
    return [
        Line2D([], [], lw=0.4, color="0.3", label="one run"),
        Line2D([], [], **black, ls=":", label="a-c: optimum, d: 3 %"),
        Line2D([], [], ls="", marker="o", ms=2, color="0.3", label="d: one run"),
        Line2D([], [], ls="", marker="_", ms=6, color="0.3", label="d: without learning"),
    ]


def _gap(ax: Axes, table: pd.DataFrame) -> None:
    period: Any
    for period, rows in table.groupby("period_mm"):
        for _, one in rows.groupby(["start_separation", "repeat"]):
            ax.plot(
                one["episode"] / 1000,
                one["smoothed_separation"],
                lw=0.4,
                alpha=0.5,
                c=COLOUR[period],
            )
        ax.axhline(rows["optimal_separation"].mean(), ls=":", lw=0.8, color=COLOUR[period])
        ax.plot([], [], color=COLOUR[period], label=f"{period:g} mm")
    ax.set(xlabel="trials (1 000)", ylabel="boundary separation of the SPRT (nats)")
    letter(ax, "a  algorithm (SPRT)")


def _levels(ax: Axes, table: pd.DataFrame) -> None:
    period: Any
    for period, rows in table.groupby("period_mm"):
        for _, one in rows.groupby(["start_level", "run"]):
            ax.plot(one["episode"] / 1000, one["level"], lw=0.4, alpha=0.5, c=COLOUR[period])
        ax.axhline(rows["best_level"].iloc[0], ls=":", lw=0.8, color=COLOUR[period])
    ax.set(xlabel="trials (1 000)", ylabel="tonic dopamine (1: normal)")


def _regret(
    ax: Axes, gap: pd.DataFrame, rates: pd.DataFrame, noisy: pd.DataFrame, spiking: pd.DataFrame
) -> None:
    period: Any
    deciders = {"algorithm": gap, "rates": rates, "noise": noisy, "spikes": spiking}
    for place, table in enumerate(deciders.values()):
        by = ["period_mm", "start_level" if "start_level" in table else "start_separation"]
        one = [*by, "run"] if "run" in table else [*by, "fold", "repeat"]
        ends = table.drop_duplicates(one)
        for period, rows in ends.groupby("period_mm"):
            x = place + 0.22 * (float(period) - 2.0) / 0.5
            spread = np.linspace(-0.06, 0.06, len(rows))
            shown = 100 * rows["regret"].clip(lower=0.01 / 100)
            ax.scatter(x + spread, shown, s=3, lw=0, color=COLOUR[period])
            for start in rows["start_regret"].unique():
                ax.scatter(x, 100 * max(start, 1e-4), marker="_", s=30, color=COLOUR[period])
    ax.axhline(3, ls=":", lw=0.8, color="k")
    ax.set(yscale="log", ylabel="cost beyond the optimum (%)")
    ax.set_xticks(range(len(deciders)), list(deciders), rotation=30, ha="right")
    letter(ax, "d  final cost")
