"""Fits of the circuit with HSSM, using the built-in network, to trials with known parameters.

``python -m figures.data.measure_hssm_check``, in an environment with HSSM (Python 3.12 or newer)
and what bgmodel needs. Decisions are simulated with the default circuit and the population engine
at three strengths of evidence, with parameters and seeds used nowhere else; HSSM fits sensitivity
(drift per strength), threshold and t0 of each data set with the network as its likelihood. The
table shows whether each parameter is inside its 94 % interval. Takes minutes per data set.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from functools import partial
from importlib import metadata, util
from typing import Any

import numpy as np
import pandas as pd

from bgmodel import stream
from bgmodel.deciding.decision import first_crossing
from bgmodel.deciding.trace import Trace
from bgmodel.fitting.simulated.network import LikelihoodNetwork, read_network
from bgmodel.integrators.basal_ganglia import ROUNDING_NATS, BasalGanglia
from circuits.anatomy import DEFAULT, load_circuit
from circuits.errors import RangeWarning
from figures.pieces import Made, Piece, Score, measure

DATA_SEED = 24_503
SAMPLING_SEED = 24_504
SETS, COARSE_SETS = 10, 1
TRIALS = 2000
STRENGTHS = (0.1, 0.2, 0.4)
SENSITIVITY, LOG_ODDS, T0_S = (5.0, 25.0), (0.6, 2.4), (0.15, 0.5)
"""Ranges from which the parameters are drawn uniformly."""
SECONDS, STEP_S = 5.0, 0.01
DRAWS, TUNE, CHAINS = 400, 400, 2
INTERVAL = (0.03, 0.97)
"""Quantiles of the posterior that bound its 94 % interval."""
NAMES = {"v_strength": "sensitivity", "threshold": "threshold", "t0": "t0"}


def truth(number: int) -> dict[str, float]:
    """Return the parameters of a data set."""
    rng = stream(DATA_SEED, "parameters", number)
    return {
        "sensitivity": float(rng.uniform(*SENSITIVITY)),
        "threshold": float(np.log1p(np.exp(-rng.uniform(*LOG_ODDS)))),
        "t0": float(rng.uniform(*T0_S)),
    }


def simulated(number: int, network: LikelihoodNetwork) -> pd.DataFrame:
    """Return the trials of a data set in HSSM's format; undecided trials are left out."""
    point, rng = truth(number), stream(DATA_SEED, "evidence", number)
    strength = rng.choice(STRENGTHS, TRIALS) * rng.choice([-1.0, 1.0], TRIALS)
    drift = point["sensitivity"] * strength[:, None, None] * np.array([1.0, -1.0])
    readings = round(SECONDS / STEP_S)
    steps = rng.normal(drift * STEP_S / 2, np.sqrt(STEP_S / 2), (TRIALS, readings, 2))
    drive = network.about["noise_nats"] * steps.cumsum(axis=1)
    model = BasalGanglia(load_circuit(DEFAULT, 2), "population", seed=DATA_SEED)
    model = model.until(point["threshold"] - ROUNDING_NATS)
    with warnings.catch_warnings():
        # A random walk eventually leaves any range.
        warnings.simplefilter("ignore", RangeWarning)
        done = model.run_drive(drive, 1000 * STEP_S, number * TRIALS)
    trace = Trace(done.output_nats, done.time_ms, step_ms=1000 * STEP_S)
    decision = first_crossing(trace, point["threshold"], forced=False)
    rt = decision.time_ms / 1000 + rng.normal(point["t0"], network.about["t0_sd_s"], TRIALS)
    response = np.where(decision.choice == 0, 1, -1)
    table = pd.DataFrame({"rt": rt, "response": response, "strength": strength})
    return table[decision.choice >= 0].reset_index(drop=True)


def posterior(table: pd.DataFrame, network: LikelihoodNetwork, number: int) -> Any:
    """Return draws of HSSM's posterior."""
    import hssm

    most = network.bounds["v"][1] / max(STRENGTHS)
    prior = {"name": "Uniform", "lower": 0.0, "upper": most, "initval": most / 4}
    drift = {"name": "v", "formula": "v ~ 0 + strength", "prior": {"strength": prior}}
    model = hssm.HSSM(table, **network.for_hssm(), include=[drift], p_outlier=0)
    return model.sample(
        sampler="numpyro",
        draws=DRAWS,
        tune=TUNE,
        chains=CHAINS,
        cores=1,
        initvals={"threshold": 0.25, "t0": float(table["rt"].min())},
        random_seed=SAMPLING_SEED + number,
        idata_kwargs={"log_likelihood": False},
        progressbar=False,
    )


def fitted(number: int) -> pd.DataFrame:
    """Return one row per parameter of a data set: truth, interval, and whether it is inside."""
    import arviz

    network, known = read_network(), truth(number)
    table = simulated(number, network)
    draws = posterior(table, network, number).posterior
    rows = []
    for theirs, ours in NAMES.items():
        values = draws[theirs].to_numpy()
        low, high = np.quantile(values, INTERVAL)
        row = {"set": number, "parameter": ours, "truth": known[ours], "mean": values.mean()}
        row |= {"low": low, "high": high, "inside": bool(low <= known[ours] <= high)}
        row |= {"r_hat": float(arviz.rhat(draws[theirs])), "answered": len(table)}
        rows.append(row)
    return pd.DataFrame(rows).assign(hssm=metadata.version("hssm"))


def pieces(fast: bool, workers: int) -> Iterator[Piece]:
    """Yield the data sets for this network; none if HSSM is not installed."""
    if util.find_spec("hssm") is None:
        return
    name = read_network().checksum[:12]
    for number in range(COARSE_SETS if fast else SETS):
        yield Piece("fits", f"{name} {number}", TRIALS, 200, partial(fitted, number))


def tables(made: Made) -> dict[str, tuple[str, pd.DataFrame]]:
    """Return a row per data set and parameter."""
    return {"check": ("fits", made["fits"])}


SCORE = Score("hssm", DATA_SEED, (2,), pieces, tables, circuit=DEFAULT)

if __name__ == "__main__":
    measure(SCORE)
