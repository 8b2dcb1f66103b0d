"""The built-in network of the circuit's likelihood versus new simulations, on a scoring seed.

A million new trials are simulated and evaluated at random parameters, as in a fit. The error is the
mean of ``|log p_network - log p_simulated|`` over the simulated trials, with the network's Gaussian
t0 in closed form. The simulations have an error too: half the difference between two halves of the
trials.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

import numpy as np
import pandas as pd

from bgmodel import stream
from bgmodel.fitting.responses import BIN_S, Grid, responded
from bgmodel.fitting.simulated.circuit_model import CircuitModel
from bgmodel.fitting.simulated.crossings import FirstPassageTimes
from bgmodel.fitting.simulated.error import decided
from bgmodel.fitting.simulated.network import LikelihoodNetwork, read_network
from circuits.anatomy import DEFAULT, load_circuit
from circuits.arrays import Array
from figures.pieces import Made, Piece, Score
from figures.rooms import OUT

SCORING_SEED = 24_502
TRIALS, COARSE_TRIALS = 143_000, 4_000
"""Trials at each of the seven drifts."""
SECONDS = 5.0
SETS = 20
T0_S = (0.1, 0.6)
BINS = 500
"""Of the time that is compared: to 5 s after the onset of evidence."""


def model_of(trials: int, seed: int) -> CircuitModel:
    """Return the model of the default circuit with ``trials`` trials at each drift."""
    folder = OUT / "crossings"
    return CircuitModel(
        load_circuit(DEFAULT, 2), seconds=SECONDS, trials=trials, seed=seed, folder=folder
    )


def density(crossings: FirstPassageTimes, point: dict[str, float], t0_sd_s: float) -> Array:
    """Return the simulated density of responses 0 and 1 at a point, (2, BINS), 1/s."""
    grid = Grid(BINS)
    decisions = decided([(crossings, 1.0)], point["threshold"], [point["v"]], grid)
    shape = {"t0_s": np.array([point["t0"]]), "t0_sd_s": np.array([t0_sd_s])}
    return responded(decisions, grid, **shape, lapse=np.zeros(1))[0]


def part(crossings: FirstPassageTimes, half: int) -> FirstPassageTimes:
    """Return one half of the trials at each drift: every other one."""
    return crossings.part(np.arange(2) == half)


def points(network: LikelihoodNetwork) -> Iterator[dict[str, float]]:
    """Yield random parameters: t0, log odds of the threshold and the root of the drift evenly.

    At most drifts nearly all choices are right: hence the root.
    """
    rng = stream(SCORING_SEED, "parameters")
    odds = -np.log(np.expm1(network.bounds["threshold"]))
    for _ in range(SETS):
        root = rng.uniform(-1, 1)
        yield {
            "v": float(root * abs(root) * network.bounds["v"][1]),
            "threshold": float(np.log1p(np.exp(-rng.uniform(odds[1], odds[0])))),
            "t0": float(rng.uniform(*T0_S)),
        }


def beside(network: LikelihoodNetwork, trials: int, seed: int = SCORING_SEED) -> pd.DataFrame:
    """Return the error of a network, and that of the simulation, at each point."""
    crossings = model_of(trials, seed).stored(())
    halves = [part(crossings, half) for half in (0, 1)]
    t0_sd_s, rt, rows = network.about["t0_sd_s"], Grid(BINS).middles_s, []
    for point in points(network):
        both, first, second = (density(each, point, t0_sd_s) for each in (crossings, *halves))
        logs = np.stack([network.log_density(**point, rt=rt, response=r) for r in (-1, 1)])
        within = (rt - point["t0"] < network.about["rt_after_t0_s"][1]) & (both > 0)
        share = np.where(within, both, 0.0) * BIN_S
        tiny = np.finfo(float).tiny

        def mean(log_ratio: Array, share: Array = share) -> float:
            return float((share * np.abs(log_ratio)).sum() / share.sum())

        row = {
            "error_nats": mean(logs - np.log(np.maximum(both, tiny))),
            "noise_nats": mean(np.log(np.maximum(first, tiny) / np.maximum(second, tiny))) / 2,
            "most_nats": float(np.abs(logs - np.log(np.maximum(both, tiny)))[both > 0.01].max()),
            "whole": float((np.exp(logs) * within).sum() * BIN_S),
            "simulated": float(share.sum()),
        }
        rows.append({**point, "accuracy": float(both[int(point["v"] > 0)].sum() * BIN_S), **row})
    return pd.DataFrame(rows)


def pieces(fast: bool, workers: int) -> Iterator[Piece]:
    """Yield the comparison; its name is that of the network, so that another one is scored anew."""
    network, trials = read_network(), COARSE_TRIALS if fast else TRIALS
    make = partial(beside, network, trials)
    yield Piece("network", network.checksum[:12], 7 * trials, 0.0003 * 7 * trials + 20, make)


def tables(made: Made) -> dict[str, tuple[str, pd.DataFrame]]:
    """Return a row per point, in the order of the threshold."""
    return {"network": ("network", made["network"].sort_values("threshold"))}


SCORE = Score("likelihood", SCORING_SEED, (2,), pieces, tables, circuit=DEFAULT)
