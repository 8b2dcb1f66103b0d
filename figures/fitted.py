"""Models fitted to monkeys and people: names and colours in figures, and runs of the circuit.

The parameters are in the tables of ``benchmarks.scores.fits``; here the fitted circuit is run on
new evidence, with all rates recorded.
"""

from __future__ import annotations

import math
import warnings
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
import pandas as pd

from bgmodel import first_crossing, stream
from bgmodel.deciding.trace import Trace
from bgmodel.fitting.exact.responses import BIN_S
from bgmodel.fitting.simulated.circuit import NOISE_NATS
from bgmodel.fitting.simulated.mechanisms import MECHANISMS
from bgmodel.integrators.basal_ganglia import BasalGanglia
from bgmodel.support.arrays import Array, Integers
from circuits.anatomy import DEFAULT, load_circuit
from circuits.circuit import Circuit
from circuits.engines import Population
from circuits.errors import RangeWarning
from figures.common import where

MONKEYS, PEOPLE = "roitman_shadlen_2002", "palmer_huk_shadlen_2005"
TEST, CIRCUIT, FALLING = "constant gap", "circuit", "falling gap"
DOPAMINE, ONSET = "circuit, rising dopamine", "circuit, STN driven at onset"
STYLE: dict[str, dict[str, Any]] = {
    TEST: {"color": "C5", "lw": 2.6},
    CIRCUIT: {"color": "C0", "lw": 1.1, "ls": "--"},
    FALLING: {"color": "C2", "lw": 2.6, "alpha": 0.6},
    DOPAMINE: {"color": "C3", "lw": 1.1},
    ONSET: {"color": "C1", "lw": 1.1},
}
"""Line style of each model: if two agree, the thin line is on top of the thick one."""
DATA: dict[str, Any] = {"color": "k", "marker": "o", "ms": 3, "ls": "", "lw": 0.8, "zorder": 4}
QUANTILES = {"q10_s": "v", "q50_s": "o", "q90_s": "^"}
"""Quantiles of times shown, and their markers."""
STRENGTHS = (0.032, 0.064, 0.128, 0.256, 0.512)
SAMPLE_MS = 5.0


def places(strength: pd.Series) -> Array:
    """Return the positions of strengths on a logarithmic axis, with zero at half the weakest."""
    some = strength[strength > 0].min()
    return np.where(strength > 0, strength, some / 2)


def mark_strengths(ax: Any, strength: pd.Series) -> None:
    """Label a logarithmic axis with every strength, per cent."""
    ax.set_xscale("log")
    shown = [f"{100 * s:.3g}" for s in strength]
    ax.set_xticks(places(strength), shown)
    ax.set_xticks([], minor=True)


def mark_quantiles(ax: Any, data: pd.DataFrame, errors: pd.DataFrame) -> None:
    """Draw the RT quantiles of one monkey, and label the strengths.

    Parameters
    ----------
    ax : Axes
        Axes to draw on.
    data, errors : DataFrame
        Columns strength and ``QUANTILES``; ``errors`` has standard errors, in the same order.
    """
    for name, mark in QUANTILES.items():
        style = DATA | {"marker": mark}
        ax.errorbar(places(data["strength"]), data[name], errors[name].to_numpy(), **style)
    mark_strengths(ax, data["strength"])
    ax.set_xlabel("coherence (%)")


def fitted(parameters: pd.DataFrame, who: str, model: str) -> dict[str, float]:
    """Return the fitted parameters of a model for a subject, by name."""
    rows = where(parameters, participant=who, model=model)
    return dict(zip(rows["parameter"], rows["value"].astype(float), strict=True))


def fitted_table(model: str, values: dict[str, float]) -> Circuit:
    """Return the default circuit, or the one with fitted STN cells that are driven at onset."""
    table = load_circuit(DEFAULT, 2)
    if model != ONSET:
        return table
    return MECHANISMS["onset_stn"].apply(table, (values["onset_nats"], values["decay_ms"]))


@dataclass(frozen=True)
class Followed:
    """The activity and decisions of a fitted circuit.

    Parameters
    ----------
    rates_hz : dict of array (trials, samples, 2), Hz
        Rates of each population.
    time_ms : array (samples,), ms
        From the onset of evidence.
    choice : int array (trials,)
        Choice; -1 if there was none.
    at_ms : array (trials,), ms
        Decision time; NaN if there was none.
    evidence : array (trials,), sqrt(s)
        Evidence for the choice minus that for the other one at that time; NaN without a choice.
    """

    rates_hz: dict[str, npt.NDArray[Any]]
    time_ms: Array
    choice: Integers
    at_ms: Array
    evidence: Array


def follow(
    table: Circuit,
    values: dict[str, float],
    strength: float,
    trials: int,
    seconds: float,
    seed: int,
) -> Followed:
    """Run a circuit with its fitted threshold, simulated as for the fit.

    Evidence comes every 10 ms, as in ``bgmodel.fitting.simulated.crossings``: Gaussian, of unit
    variance per second in the difference of the channels, and with a drift of the sensitivity times
    the strength in favour of channel 0. The same seed gives every circuit the same evidence.

    Parameters
    ----------
    table : Circuit
        A circuit with two channels.
    values : dict of float
        Fitted parameters; sensitivity and threshold_nats are used.
    strength : float
        Coherence.
    trials, seconds, seed :
        Number of trials, their duration (s), and the seed of evidence and noise.
    """
    readings = math.ceil(seconds / BIN_S)
    rng = stream(seed, "fitted", f"{strength:g}")
    steps = rng.normal(0.0, math.sqrt(BIN_S / 2), (trials, readings, 2))
    drift = values["sensitivity"] * strength
    read = (steps + np.array([drift, -drift]) * BIN_S / 2).cumsum(axis=1)
    model = BasalGanglia(table, Population(sample_ms=SAMPLE_MS), seed=seed)
    with warnings.catch_warnings():
        # As in the fit: a random walk eventually leaves any range.
        warnings.simplefilter("ignore", RangeWarning)
        done = model.run_drive(NOISE_NATS * read, 1000 * BIN_S)
    trace = Trace(done.output_nats, done.time_ms, step_ms=1000 * BIN_S)
    decided = first_crossing(trace, values["threshold_nats"], forced=False)
    there = decided.choice >= 0
    at_ms = np.where(there, decided.time_ms, np.nan)
    # A tick at the very end of a reading still receives that reading.
    last = np.ceil(np.where(there, decided.time_ms, 1000 * BIN_S) / (1000 * BIN_S) - 1e-9) - 1
    last = np.clip(last, 0, readings - 1).astype(np.int64)
    apart = (read[:, :, 0] - read[:, :, 1])[np.arange(trials), last]
    towards = np.where(decided.choice == 0, apart, -apart)
    evidence = np.where(there, towards, np.nan)
    return Followed(dict(done.rates_hz), done.time_ms, decided.choice, at_ms, evidence)
