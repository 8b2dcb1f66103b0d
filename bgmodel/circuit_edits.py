"""Edits of a circuit that a study goes through, and what they do under steady evidence."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields, replace

import numpy as np
import numpy.typing as npt
import pandas as pd
from scipy.stats import ttest_1samp

from bgmodel.basal_ganglia import (
    BasalGanglia,
    Circuit,
    Escape,
    Population,
    Projection,
    Rate,
)

OF_POPULATIONS = ("baseline_hz", "gain_hz_per_nat", "bias_nats", "tau_ms")
OF_PROJECTIONS = ("weight", "delay_ms", "tau_ms")
SPARE_NATS = 0.6
SETTLE_MS = 1500
"""Until the slow common mode of a lesioned circuit is within 1e-4 nats of where it ends."""


def perturbed(circuit: Circuit, fraction: float = 0.2) -> dict[str, Circuit]:
    """Return the circuit with one number changed by +-fraction, for every number of its tables.

    Delays are rounded to whole ticks of .1 ms. Numbers that are 0 stay out, and so do those that
    only say what they are: transmitters, names, numbers of cells.
    """
    changed: dict[str, Circuit] = {}

    def put(name: str, values: Mapping[str, float]) -> None:
        for field, value in values.items():
            for sign in (1, -1):
                new = value * (1 + sign * fraction)
                new = round(new, 1) if field == "delay_ms" else new
                key = f"{name} {field} {sign * fraction:+.0%}"
                changed[key] = circuit.changed(name, **{field: new})

    for row in circuit.populations:
        cell = {f.name: getattr(row.cell, f.name) for f in fields(row.cell)}
        own = {name: getattr(row, name) for name in OF_POPULATIONS}
        put(row.name, {k: v for k, v in (own | cell).items() if v and not isinstance(v, bool)})
    for p in circuit.projections:
        values = {name: getattr(p, name) for name in OF_PROJECTIONS}
        put(p.name, {k: v for k, v in values.items() if v})
    for sign in (1, -1):
        tau_ms = circuit.readout_tau_ms * (1 + sign * fraction)
        key = f"read-out tau_ms {sign * fraction:+.0%}"
        changed[key] = replace(circuit, readout_tau_ms=tau_ms)
    return changed


def correlated(
    circuit: Circuit, noise_nats: float, *, cells: int = 20, tau_ms: float = 20
) -> Circuit:
    """Return the circuit with noise that all cortical cells of a channel share.

    Parameters
    ----------
    circuit : Circuit
        One with cells.
    noise_nats : float
        Standard deviation of the shared input, nats.
    cells, tau_ms : int, float
        It comes from this many Poisson cells of 20 Hz, filtered with this time constant (ms); their
        mean input is taken off.
    """
    rate_hz = 20.0
    # Shot noise through an exponential filter (Campbell): variance = rate / (2 tau cells).
    sd_hz = np.sqrt(rate_hz / (2 * tau_ms / 1000 * cells))
    gain = sd_hz / noise_nats
    shared = Population("shared", Escape(), rate_hz, gain, neurons=cells, cite="assumed")
    path = Projection("shared", circuit.input, 1, delay_ms=1, tau_ms=tau_ms, cite="assumed")
    return circuit.with_rows(shared, path)


def linear_stn(circuit: Circuit) -> Circuit:
    """Return the circuit whose STN is linear: its exponential's tangent at rest.

    At rest a channel's activity is Sigma / N = a; there ``e^u`` is about ``a (u + 1 - ln a)``. It
    has no floor, for a line that stops at 0 is still convex, and no noise, which favours it. OUT is
    then the average less the winner, as far as cortex is not silent. It falls further than -ln P:
    SNr gets ``SPARE_NATS`` more tonic drive, or it would fall silent before a decision at .95.
    """
    silence = np.zeros((1, 1, circuit.channels))
    activity = BasalGanglia(circuit).at(silence, step_ms=1.0)
    rest = float(activity.decoded_nats("STN").mean())
    bias = circuit.population("STN").bias_nats + 1 - float(np.log(rest))
    spare = circuit.population("SNr").bias_nats + SPARE_NATS
    edited = circuit.changed("STN", cell=Rate(signed=True), transfer="linear", bias_nats=bias)
    for target in ("common", "GPe", "SNr"):
        edited = edited.scaled("STN", target, rest)
    return edited.changed("SNr", bias_nats=spare)


def shuffled_stn(circuit: Circuit) -> Circuit:
    """Return the circuit where SNr hears N times the next channel's STN in place of STN's sum."""
    weight = circuit.channels * circuit.projection("STN", "SNr").weight
    return circuit.changed("STN->SNr", pattern="neighbour", weight=weight)


def out_shift(
    circuit: Circuit, edited: Circuit, out_nats: npt.ArrayLike, *, laws: str = "table"
) -> npt.NDArray[np.float64]:
    """Return what an edit adds to the winner's OUT at the fixed point, nats.

    Where any OUT that is asked for has no fixed point, or none that is known, all are NaN.

    Parameters
    ----------
    circuit, edited : Circuit
        Before and after.
    out_nats : array (...)
        ``-ln P`` before, at which it is asked; the result has its shape.
    laws : str
        "table", "cells" or "finite", as for ``circuits.engines.algebra``.
    """
    n = circuit.channels
    out = np.asarray(out_nats, dtype=np.float64)
    drive = np.zeros((out.size, 1, n))
    drive[:, 0, 0] = (np.log(n - 1) - np.log(np.expm1(out))).ravel()
    drive -= drive.mean(axis=2, keepdims=True)
    try:
        before, after = (
            BasalGanglia(c, options={"laws": laws}).at(drive, step_ms=1.0).output_nats
            for c in (circuit, edited)
        )
    except ValueError:
        return np.full_like(out, np.nan)
    return (after - before)[:, 0, 0].reshape(out.shape)


def steady_out(
    circuit: Circuit, log_odds: npt.ArrayLike, *, seed: int, trials: int, mean_ms: int = 1000
) -> npt.NDArray[np.float64]:
    """Return the favoured channel's OUT under constant evidence, (log odds, trials) nats.

    Parameters
    ----------
    circuit : Circuit
        One of spiking cells.
    log_odds : array
        Of the favoured channel against each other one, in the circuit's nats.
    seed, trials : int
        Noise; trial t has the same in every circuit.
    mean_ms : int
        The time that is averaged, after ``SETTLE_MS``.
    """
    odds = np.asarray(log_odds, dtype=np.float64)
    drive = np.zeros((len(odds) * trials, 1, circuit.channels))
    drive[:, 0, 0] = np.repeat(odds, trials)
    drive -= drive.mean(axis=2, keepdims=True)
    model = BasalGanglia(circuit, "ensemble", seed=seed, options={"rates": False, "sample_ms": 5.0})
    out = model.at(drive, step_ms=float(SETTLE_MS + mean_ms)).output_nats
    found = out[:, SETTLE_MS // 5 :, 0].mean(axis=1)
    return found.reshape(len(odds), trials)


def steady_shifts(
    circuit: Circuit,
    edited: Mapping[str, Circuit],
    log_odds: npt.ArrayLike,
    *,
    seed: int,
    trials: int = 40,
) -> pd.DataFrame:
    """Measure what edits add to OUT in the spiking circuit, beside its fixed point.

    Returns
    -------
    DataFrame
        One row a variant and log odds: variant, log_odds, out_nats (as it is), exact_nats (the
        shift of the algebraic fixed point), own_laws_nats and finite_nats (the same with the cells'
        own f-I laws, and with the noise of their finite number), value, low, high (the
        measured shift and its 95 % interval, trials paired by their noise).
    """
    odds = np.asarray(log_odds, dtype=np.float64)
    out = np.log1p((circuit.channels - 1) * np.exp(-odds))
    before = steady_out(circuit, odds, seed=seed, trials=trials)
    parts = []
    for name, table in edited.items():
        shift = steady_out(table, odds, seed=seed, trials=trials) - before
        interval = ttest_1samp(shift, 0.0, axis=1).confidence_interval()
        columns = {
            "variant": name,
            "log_odds": odds,
            "out_nats": before.mean(axis=1),
            "exact_nats": out_shift(circuit, table, out),
            "own_laws_nats": out_shift(circuit, table, out, laws="cells"),
            "finite_nats": out_shift(circuit, table, out, laws="finite"),
            "value": shift.mean(axis=1),
            "low": interval.low,
            "high": interval.high,
        }
        parts.append(pd.DataFrame(columns))
    return pd.concat(parts, ignore_index=True)
