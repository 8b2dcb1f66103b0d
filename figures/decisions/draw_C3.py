"""Figure C3: circuit and MSPRT on the same evidence: decision times, agreement, speed-accuracy."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from bgmodel import stream
from bgmodel.bootstrap import FEWEST_TRIALS
from bgmodel.comparison.matched import matched_measures
from bgmodel.comparison.thresholds import MSPRT, MSPRT_AT_GAIN, msprt_tradeoffs
from bgmodel.deciding.tradeoff import Tradeoff, curve, tradeoff
from bgmodel.evidence import Evidence
from bgmodel.integrators.at_thresholds import (
    CIRCUIT,
    DECODER,
    decide_at_thresholds,
    thresholds_about,
)
from bgmodel.integrators.basal_ganglia import BasalGanglia
from bgmodel.integrators.baselines import MaxVsAverage, Race
from bgmodel.integrators.criterion import gain_of
from bgmodel.simulated_evidence import gaussian_evidence
from bgmodel.support.files import read_table, write_table
from bgmodel.tactile.source import Folds, folds
from bgmodel.tactile.task import SameDifferent
from circuits.anatomy import DEFAULT, load_circuit
from figures.common import Settings, bars, key, letter, where

AT = 0.95
ACCURACIES = (0.90, 0.95, 0.97)
TACTILE = "grating 2 mm"
COLOURS = {"N = 2": "C0", "N = 4": "C1", "N = 8": "C2", TACTILE: "C3"}


def conditions(settings: Settings, taps: pd.DataFrame) -> Iterator[tuple[str, Evidence]]:
    """Yield the evidence of each condition, readings every 50 ms."""
    most = settings.circuit_trials
    for count, share in ((2, 1.0), (4, 0.5), (8, 1 / 3)):
        rng = stream(settings.seed, "figC3", count)
        trials = max(int(share * most), FEWEST_TRIALS)
        given: dict[str, Any] = {"d_prime": settings.d_prime, "channels": count, "t_max": 120}
        yield f"N = {count}", gaussian_evidence(trials, seed=rng, **given)
    readings = tactile(taps)
    rng = stream(settings.seed, "figC3", "tactile")
    yield TACTILE, readings.draw(most, 40, rng=rng, step_ms=50.0)


def tactile(taps: pd.DataFrame) -> Folds:
    """Return the readings of the grating, of six folds of taps."""
    return folds(taps, SameDifferent(period_mm=2.0))


def compute(settings: Settings, taps: Path, *, output: Path) -> None:
    """Compare under every condition; write measures and curves, and single trials separately."""
    measures, trials = [], []
    read = read_table(taps)
    for name, evidence in conditions(settings, read):
        groups = tactile(read).groups(evidence.trials) if name == TACTILE else None
        table = load_circuit(DEFAULT, evidence.hypotheses)
        gain = gain_of(table)
        model = BasalGanglia(table, "spikes", gain, settings.seed)
        swept = msprt_tradeoffs(evidence, gain)
        swept |= decide_at_thresholds(model, evidence, thresholds_about(swept[MSPRT_AT_GAIN]))
        for label, baseline in (("race", Race()), ("max vs average", MaxVsAverage())):
            if name in ("N = 4", "N = 8"):
                swept[label] = tradeoff(baseline.run(evidence), evidence)
        for label in (CIRCUIT, DECODER):
            found = matched_measures(
                swept[MSPRT_AT_GAIN],
                swept[label],
                rng=stream(settings.seed, "bootstrap"),
                truth=evidence.truth,
                accuracies=ACCURACIES,
                # There are many trials but few taps, so the interval is over six folds of taps.
                groups=groups,
            )
            measures.append(found.assign(condition=name, model=label, what="measure"))
        for label, one in swept.items():
            measures.append(_curve(one).assign(condition=name, model=label, what="curve"))
        trials.append(_trials(swept[MSPRT_AT_GAIN], swept[CIRCUIT]).assign(condition=name))
    write_table(pd.concat(measures), output, seed=settings.seed, settings=settings)
    beside = output.with_stem(output.stem + "_trials")
    write_table(pd.concat(trials), beside, seed=settings.seed, settings=settings)


def _curve(swept: Tradeoff) -> pd.DataFrame:
    accuracy, time = curve(swept, np.ones((1, swept.trials)))
    return pd.DataFrame({"accuracy": accuracy[0], "measure": "mean_ms", "value": time[0]})


def _trials(test: Tradeoff, other: Tradeoff) -> pd.DataFrame:
    rows = [int(np.flatnonzero(one.settings == one.setting(AT))[0]) for one in (test, other)]
    return pd.DataFrame(
        {
            "test_ms": test.time_ms[rows[0]],
            "circuit_ms": other.time_ms[rows[1]],
            "same_choice": test.choice[rows[0]] == other.choice[rows[1]],
        }
    )


def draw(settings: Settings, data: Path, trials: Path, *, output: Path) -> Figure:
    """Draw decision times, measures of circuit and cortical decoder, and speed-accuracy curves."""
    table, single = read_table(data), read_table(trials)
    figure, axes = plt.subplots(3, 4, figsize=(7.2, 6.4), height_ratios=[1.15, 1, 1.15])
    for ax, (name, colour) in zip(axes[0], COLOURS.items(), strict=True):
        _scatter(ax, single[single["condition"] == name], colour)
        letter(ax, name)
    letter(axes[0, 0], "a  decision times, N = 2")
    axes[0, 0].set_ylabel("circuit (s)")
    shown = {
        "agreement": "b  same choice\n(share)",
        "error_agreement": "same choice where\nthe MSPRT errs (share)",
        "pearson_r": "r of decision times",
        "extra_ms": "extra time (ms)",
    }
    measures = table[table["what"] == "measure"]
    for ax, (measure, label) in zip(axes[1], shown.items(), strict=True):
        _measures(ax, measures[measures["measure"] == measure])
        ax.set(xlabel="accuracy", title=label)
    curves = table[table["what"] == "curve"]
    for ax, name in zip(axes[2], COLOURS, strict=True):
        _speed_accuracy(ax, curves[curves["condition"] == name])
        letter(ax, name)
    letter(axes[2, 0], "c  speed, accuracy, N = 2")
    axes[2, 0].set_ylabel("expected accuracy")
    other = Line2D([], [], color="k", ls="", marker="x", ms=3, mew=0.7, label="other choice")
    title = "a: one mark per trial.  b: filled circuit, open cortical decoder"
    key(figure, axes[1, 0], more=[other], loc="outside lower left", ncols=3, title=title)
    key(figure, axes[2, -1], loc="outside lower right", ncols=3, title="c: lines")
    return figure


def _scatter(ax: Axes, rows: pd.DataFrame, colour: str) -> None:
    top = 1.05 * rows[["test_ms", "circuit_ms"]].to_numpy().max() / 1000
    ax.plot([0, top], [0, top], color="0.8", lw=0.8, zorder=0)
    for same, style in ((True, {"color": colour, "alpha": 0.35}), (False, {"color": "k"})):
        here = rows[rows["same_choice"] == same]
        x, y = here["test_ms"] / 1000, here["circuit_ms"] / 1000
        ax.plot(x, y, "." if same else "x", ms=3, mew=0.7, rasterized=True, **style)
    r = np.corrcoef(rows["test_ms"], rows["circuit_ms"])[0, 1]
    ax.text(0.05, 0.93, f"r = {r:.2f}\n{len(rows)} trials", transform=ax.transAxes, va="top")
    ax.set(xlabel="MSPRT (s)", xlim=(0, top), ylim=(0, top), aspect="equal")


def _measures(ax: Axes, rows: pd.DataFrame) -> None:
    for i, (name, colour) in enumerate(COLOURS.items()):
        # Side by side, so that marks do not overlap when both are 1.
        for label, aside, face in ((CIRCUIT, -0.045, colour), (DECODER, 0.045, "w")):
            here = where(rows, condition=name, model=label)
            x = np.arange(len(here)) + 0.2 * (i - 1.5) + aside
            style: dict[str, Any] = {"fmt": "o", "ms": 2.5, "lw": 0.8, "color": colour}
            bars(ax, x, here, mfc=face, label=name if label == CIRCUIT else None, **style)
    if rows["measure"].iloc[0].endswith("agreement"):
        ax.margins(y=0.08)
    ax.set_xticks(range(len(ACCURACIES)), [f"{a:.2f}" for a in ACCURACIES])


def _speed_accuracy(ax: Axes, rows: pd.DataFrame) -> None:
    styles: dict[str, dict[str, Any]] = {
        MSPRT_AT_GAIN: {"color": "k", "lw": 1.2},
        MSPRT: {"color": "k", "lw": 0.8, "ls": ":"},
        CIRCUIT: {"color": "C3", "lw": 1.2},
        DECODER: {"color": "C3", "lw": 0.8, "ls": "--"},
        "max vs average": {"color": "C4", "lw": 0.8},
        "race": {"color": "C5", "lw": 0.8},
    }
    for name, style in styles.items():
        here = rows[(rows["model"] == name) & (rows["value"] > 0)]
        ax.plot(here["value"] / 1000, here["accuracy"], label=name, **style)
    at = rows[(rows["model"] == MSPRT_AT_GAIN) & (rows["accuracy"] < 0.99)]
    ax.set(xlabel="mean decision time (s)", ylim=(0.6, 1.0), xlim=(0, 1.35e-3 * at["value"].max()))
