"""A group's fit: the labelled tree that ArviZ reads, data and model by cell, and its figure."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from dataclasses import replace
from textwrap import fill
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from bgmodel.fitting.optimum import Optimum
from bgmodel.fitting.person_fit import SHARE, cells_of
from bgmodel.fitting.responses import BinnedResponses, Grid
from bgmodel.support import __version__
from bgmodel.support.seeds import stream
from circuits.arrays import Array, Integers
from circuits.plots import GREY, PALETTE, panels, styled

if TYPE_CHECKING:
    import xarray
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from bgmodel.fitting.likelihood import Likelihood

MOST_DRAWS = 100
"""Largest number of draws of each chain with log likelihoods of trials, and with new trials."""
PREDICTIVE_SEED = 47_301
"""Seed of the new trials."""


def labelled(
    group: Mapping[str, Array],
    individual: Mapping[str, Array],
    log_likelihood: Array,
    likelihoods: Mapping[str, Likelihood],
) -> xarray.DataTree:
    """Return the draws of a fit as a tree; ``individual`` is in the order of the parameters.

    ``log_likelihood`` and ``posterior_predictive`` have at most ``MOST_DRAWS`` draws of each chain.
    """
    import xarray

    people = list(likelihoods)
    chains, draws, _ = log_likelihood.shape
    axes = {"chain": np.arange(chains), "draw": np.arange(draws)}
    posterior: dict[str, tuple[tuple[str, ...], Array]] = {
        name: (("chain", "draw"), values) for name, values in group.items()
    }
    posterior |= {
        f"{name}_of": (("chain", "draw", "participant"), values)
        for name, values in individual.items()
    }
    total = (("chain", "draw"), log_likelihood.sum(axis=2))
    places = np.unique(np.linspace(0, draws - 1, min(draws, MOST_DRAWS)).astype(int))
    vectors = np.stack(list(individual.values()), axis=3)
    of_trials = ("chain", "draw", "trial")
    each = (of_trials, each_trial(likelihoods, vectors[:, places]))
    new = zip(("rt", "response"), new_trials(likelihoods, vectors[:, places]), strict=True)
    predictive = {name: (of_trials, values) for name, values in new}
    seen = [one.design.observed for one in likelihoods.values()]
    who = ("trial", np.repeat(people, [len(one.response) for one in seen]))
    data = {
        "rt": ("trial", np.concatenate([one.rt_s for one in seen])),
        "response": ("trial", np.concatenate([one.response for one in seen])),
    }
    coordinates = {"chain": axes["chain"], "draw": places, "participant_of": who}
    tree = xarray.DataTree.from_dict(
        {
            "posterior": xarray.Dataset(posterior, {**axes, "participant": people}),
            "sample_stats": xarray.Dataset({"lp": total}, axes),
            "log_likelihood": xarray.Dataset({"rt": each}, coordinates),
            "posterior_predictive": xarray.Dataset(predictive, coordinates),
            "observed_data": xarray.Dataset(data, {"participant_of": who}),
            "constant_data": xarray.Dataset(given_trials(likelihoods), {"participant_of": who}),
        }
    )
    tree.attrs = {"inference_library": "bgmodel", "inference_library_version": __version__}
    return tree


def each_trial(likelihoods: Mapping[str, Likelihood], vectors: Array) -> Array:
    """Return the log likelihood of each trial at draws, (chains, draws, trials), nats."""
    parts = [
        np.array([[likelihood.each(vector) for vector in chain[:, k]] for chain in vectors])
        for k, likelihood in enumerate(likelihoods.values())
    ]
    return np.concatenate(parts, axis=2)


def new_trials(likelihoods: Mapping[str, Likelihood], vectors: Array) -> tuple[Array, Integers]:
    """Return times, s, and responses of one new trial in place of each, (chains, draws, trials)."""
    trials = [len(one.design.observed.response) for one in likelihoods.values()]
    shape = (*vectors.shape[:2], sum(trials))
    rt_s, response = np.empty(shape, np.float32), np.empty(shape, np.int8)
    ends = np.cumsum(trials)
    for k, (who, likelihood) in enumerate(likelihoods.items()):
        rng, part = stream(PREDICTIVE_SEED, who), slice(ends[k] - trials[k], ends[k])
        likelihood = likelihood.complete(np.median(vectors[:, :, k], axis=(0, 1)))
        for at in np.ndindex(shape[:2]):
            rt_s[(*at, part)], response[(*at, part)] = likelihood.drawn(vectors[(*at, k)], rng)
    return rt_s, response


def given_trials(likelihoods: Mapping[str, Likelihood]) -> dict[str, tuple[str, np.ndarray]]:
    """Return the absolute strength and the conditions of each trial."""
    designs = [one.design for one in likelihoods.values()]
    parts: dict[str, list[np.ndarray]] = {
        name: [np.array(design.conditions[name]) for design in designs]
        for name in designs[0].conditions
    }
    parts["strength"] = [design.strength for design in designs]
    return {
        name: ("trial", np.concatenate([
            values[design.observed.cell] for values, design in zip(cells, designs, strict=True)
        ]))
        for name, cells in parts.items()
    }  # fmt: skip


def pooled(people: Collection[Optimum]) -> pd.DataFrame | None:
    """Return ``cells_of`` everyone's trials and model, or None if strengths or conditions differ.

    The prediction for a cell is the mixture of the people's distributions, so that data and model
    are pooled alike.
    """
    people = [each.complete for each in people]
    designs = [each.likelihood.design for each in people]
    every = [list(zip(each.strength, *each.conditions.values(), strict=True)) for each in designs]
    order = {cell: number for number, cell in enumerate(every[0])}
    if any(set(cells) != set(order) for cells in every):
        return None
    places = [np.array([order[cell] for cell in cells]) for cells in every]
    mass = np.zeros((len(order), 2, max(each.grid.bins for each in designs)))
    trials = np.zeros(len(order))
    for each, design, place in zip(people, designs, places, strict=True):
        predicted, _ = design.observed.outcomes(each.density)
        mass[place, :, : predicted.shape[2]] += design.trials[:, None, None] * predicted
        trials[place] += design.trials
    seen = [design.observed for design in designs]
    together = BinnedResponses(
        np.concatenate([place[one.cell] for place, one in zip(places, seen, strict=True)]),
        np.concatenate([one.response for one in seen]),
        np.concatenate([one.rt_s for one in seen]),
        Grid(mass.shape[2], seen[0].grid.width_s),
        alternatives=seen[0].alternatives,
        untimed=seen[0].untimed,
    )
    density = mass / trials[:, None, None] / seen[0].grid.width_s
    return cells_of(replace(designs[0], observed=together), density)


COLUMNS = 3
"""Panels in a row."""
WIDTH = 32
"""Characters in a line of a panel's title."""
LABELS = {"sensitivity": "sensitivity (1/√s)", "bound": "bound (√s)"}
"""Names of parameters with units; other names contain theirs."""


def legend(parameters: Iterable[str], *, signed: bool = False) -> str:
    """Return how to read a table of a group, and if ``signed`` also its column above_zero."""
    named = {name.partition("[")[0] for name in parameters}
    units = [label for name, label in LABELS.items() if name in named]
    read = [
        f"low to high: {100 * SHARE:.0f} % of the posterior",
        *(["above_zero: a probability"] * signed),
    ]
    return "; ".join([*read, *units])


@styled
def draw_group(people: pd.DataFrame, group: pd.DataFrame, trials: int) -> Figure:
    """Draw a panel for each parameter: people by their medians, and the group, with 90 %."""
    count = people["participant"].nunique()
    rows = -(-len(group) // COLUMNS)
    figure, grid = panels(rows, COLUMNS, size=(7.2, 0.5 + rows * (1.1 + 0.13 * count)))
    axes = grid.ravel()
    place = np.arange(count)
    first: dict[str, tuple[pd.Index, Axes]] = {}
    for ax, (name, shared) in zip(axes, group.iterrows(), strict=False):
        parameter, _, condition = str(name).removesuffix("]").partition("[")
        estimates = people[people["parameter"] == name].set_index("participant")
        # Coefficients of a formula are values of different kinds.
        alike = parameter if "=" in condition else str(name)
        order, like = first.setdefault(alike, (estimates["median"].sort_values().index, ax))
        estimates = estimates.loc[order]
        if like is not ax:
            ax.sharex(like)
        ax.axvspan(shared["low"], shared["high"], color=PALETTE[0], alpha=0.2, lw=0)
        ax.axvline(shared["median"], color=PALETTE[0], ls="--")
        ax.hlines(place, estimates["low"], estimates["high"], color=GREY, lw=1)
        ax.plot(estimates["median"], place, "ko", ms=3)
        ax.set(title=fill(condition, WIDTH), yticks=place, ylim=(-0.8, count - 0.2))
        label = LABELS.get(parameter, parameter)
        plain = "=" in condition or condition in ("", "Intercept")
        ax.set_xlabel(label if plain else f"{label}: coefficient")
        ax.set_yticklabels(estimates.index, fontsize=5.5)
    for row in grid:
        row[0].set_ylabel("Participant")
    for ax in axes[len(group) :]:
        ax.remove()
    figure.suptitle(
        f"{count} people, {trials} trials: medians and intervals of 90 % of each person (black) "
        "and of the median person (colour)",
        x=0.01,
        ha="left",
    )
    return figure
