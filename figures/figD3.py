"""Figure D3: the gap and dopamine track a changing environment; behaviour after an error.

The learning rate stays constant, because the target of learning (the cost of an error, or the
grating) changes.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from bgmodel import stream
from bgmodel.evidence import Evidence
from bgmodel.integrators.basal_ganglia import BasalGanglia
from bgmodel.integrators.criterion import gain_of
from bgmodel.learning.dopamine import playable_levels
from bgmodel.learning.dopamine_learner import after_errors, learn_level, level_outcomes
from bgmodel.learning.gap import increments
from bgmodel.learning.policies import GaussianPolicy
from bgmodel.learning.reinforce import Environment, Learned, Learner, learn, smoothed
from bgmodel.learning.worlds import LevelOutcomes, switching, trials_of
from bgmodel.support.files import read_table, write_table
from bgmodel.tactile.source import Source, source
from bgmodel.tactile.task import SameDifferent
from bgmodel.theory.sprt import optimal_separation
from circuits.anatomy import DEFAULT, load_circuit
from circuits.engines import Rate
from figures.common import Settings, letter, run, where

STEP_MS = 50.0
RUNS = 20
BLOCK_SHARE = 5
"""Blocks in a course of learning."""
WORLDS = {"xi": ((2.0, 50.0), (2.0, 400.0)), "grating": ((2.0, 50.0), (1.5, 50.0))}
"""Grating (mm) and cost of an error (readings), in turn."""
CARRIED = (0.0, 0.2)
STEADY = Learner(rate=0.02, half_episodes=np.inf)
EXPLORED: dict[str, Any] = {"first_share": 0.08, "last_share": 0.08}


def compute(settings: Settings, taps: Path, *, output: Path) -> None:
    """Train algorithm and rate circuit in switching environments; measure post-error effects."""
    read = read_table(taps)
    periods = {period for world in WORLDS.values() for period, _ in world}
    sources = {p: source(read, SameDifferent(period_mm=p), fold=0) for p in periods}
    table = load_circuit(DEFAULT)
    model = BasalGanglia(table, Rate().coarse(), gain_of(table))
    levels = playable_levels(model, 22)
    outcomes = {
        period: level_outcomes(model, _drawn(readings, settings, period), levels)
        for period, readings in sources.items()
    }
    policy = GaussianPolicy(bounds=(levels[0], levels[-1]), **EXPLORED)
    parts = []
    for name in WORLDS:
        parts.append(_algorithm(sources, settings, name).assign(world=name, model="algorithm"))
        course = _circuit(outcomes, settings, name, policy)
        parts.append(course.assign(world=name, model="circuit"))
    parts += [_after_errors(outcomes[1.5], settings, carried, policy) for carried in CARRIED]
    write_table(pd.concat(parts), output, seed=settings.seed, settings=settings)


def _drawn(readings: Source, settings: Settings, period_mm: float) -> Evidence:
    rng = stream(settings.seed, "figD3", period_mm)
    return readings.draw(settings.circuit_trials, settings.t_max, rng=rng, step_ms=STEP_MS)


def _algorithm(sources: dict[float, Source], settings: Settings, name: str) -> pd.DataFrame:
    """Learn the gap of an SPRT in a switching environment."""
    world, every = WORLDS[name], _block(settings)
    learned = learn(
        switching([_sprt(sources[p], xi, settings, name) for p, xi in world], every),
        4.0,
        rngs=_explored(settings, name, "algorithm"),
        policy=GaussianPolicy(**EXPLORED),
        learner=_learner(settings),
    )
    best = [
        optimal_separation(
            *increments(sources[p]), xi, t_max=settings.t_max, bounds=(0, 8)
        ).boundary_separation
        for p, xi in world
    ]
    return _course(learned, best, every)


def _circuit(
    outcomes: dict[float, LevelOutcomes], settings: Settings, name: str, policy: GaussianPolicy
) -> pd.DataFrame:
    """Learn the level of dopamine in a switching environment."""
    world, every = WORLDS[name], _block(settings)
    draws = [stream(settings.seed, "figD3", name, i, "trials") for i in range(RUNS)]
    learned = learn(
        switching([outcomes[p].environment(xi, draws) for p, xi in world], every),
        1.2,
        rngs=_explored(settings, name, "circuit"),
        policy=policy,
        learner=_learner(settings),
    )
    return _course(learned, [outcomes[p].best(xi)[0] for p, xi in world], every)


def _after_errors(
    outcomes: LevelOutcomes, settings: Settings, carried: float, policy: GaussianPolicy
) -> pd.DataFrame:
    """Learn a level with the last reward carried over, and measure the trial after an error."""
    learned = learn_level(
        outcomes,
        xi=settings.xi,
        start_level=1.3,
        runs=RUNS,
        seed=settings.seed,
        name=("after errors", carried),
        policy=policy,
        learner=replace(_learner(settings), carried=carried),
    )
    return after_errors(learned, settings.xi).assign(world="errors", carried=carried)


def _learner(settings: Settings) -> Learner:
    return replace(STEADY, episodes=settings.episodes)


def _block(settings: Settings) -> int:
    return settings.episodes // BLOCK_SHARE


def _explored(settings: Settings, *name: str) -> list[np.random.Generator]:
    return [stream(settings.seed, "figD3", *name, i, "explored") for i in range(RUNS)]


def _sprt(readings: Source, xi: float, settings: Settings, name: str) -> Environment:
    rngs = [stream(settings.seed, "figD3", name, i, xi, "sprt") for i in range(RUNS)]
    draws = [lambda trials, rng=rng: readings.draw(trials, settings.t_max, rng=rng) for rng in rngs]
    return trials_of(draws, xi)


def _course(learned: Learned, best: list[float], every: int) -> pd.DataFrame:
    runs, episodes = learned.played.shape
    at = np.linspace(0, episodes - 1, 300).round().astype(int)
    curves = smoothed(learned.mean_played, 50)[:, at]
    return pd.DataFrame(
        {
            "run": np.repeat(np.arange(runs), len(at)),
            "episode": np.tile(at, runs),
            "value": curves.ravel(),
            "best": np.tile([best[(k // every) % len(best)] for k in at], runs),
        }
    )


def draw(settings: Settings, data: Path, *, output: Path) -> Figure:
    """Draw learned values in switching environments, and the trial after an error."""
    table = read_table(data)
    figure, axes = plt.subplots(2, 3, figsize=(7.2, 3.8), width_ratios=[1, 1, 0.6])
    titles = {"xi": "a  cost of an error: 50 or 400", "grating": "b  grating of 2.0 or 1.5 mm"}
    names = {"algorithm": "gap (nats)", "circuit": "tonic dopamine\n(1: normal)"}
    for row, (model, label) in zip(axes, names.items(), strict=True):
        for ax, (world, title) in zip(row, titles.items(), strict=False):
            rows = where(table, world=world, model=model)
            for _, one in rows.groupby("run"):
                ax.plot(one["episode"] / 1000, one["value"], lw=0.4, alpha=0.3, color="C0")
            middle = rows.groupby("episode")["value"].median()
            ax.plot(middle.index / 1000, middle, lw=1.6, color="C0")
            first = where(rows, run=0)
            ax.plot(first["episode"] / 1000, first["best"], lw=1, color="k", ls=":")
            ax.set(ylabel=f"{model}:\n{label}" if world == "xi" else "")
            if model == "algorithm":
                letter(ax, title)
            else:
                ax.set(xlabel="trials (1 000)")
    errors = where(table, world="errors")
    ax = axes[0, 2]
    for place, (_, rows) in enumerate(errors.groupby("carried")):
        spread = np.linspace(-0.15, 0.15, len(rows))
        ax.scatter(place + spread, rows["slower"], s=6, lw=0, color=f"C{place}")
    ax.axhline(0, lw=0.8, color="0.6")
    ax.set(ylabel="slower after an\nerror (readings)")
    ax.set_xticks(range(len(CARRIED)), ["error\nforgotten", "error\ncarried"])
    axes[1, 2].axis("off")
    axes[1, 2].legend(handles=_key(), loc="center left", title="a, b")
    letter(ax, "c  after an error")
    return figure


def _key() -> list[Line2D]:
    return [
        Line2D([], [], lw=0.4, color="C0", label="one run"),
        Line2D([], [], lw=1.6, color="C0", label=f"median of {RUNS} runs"),
        Line2D([], [], lw=1, color="k", ls=":", label="optimum of the block"),
    ]


if __name__ == "__main__":
    run(compute=compute, draw=draw)
