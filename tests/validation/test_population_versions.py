"""The population engine compared with that of version 0.3.0, whose noise and lanes were others.

``population_0_3.csv`` was written by ``python tests/validation/test_population_versions.py``
with the engine of version 0.3.0 and seed 46001: decisions of 20 000 trials, and spectra of 400.
"""

import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy.signal import welch

from circuits import anatomy
from circuits.engines import run

pytestmark = pytest.mark.validate
PATH = Path(__file__).with_name("population_0_3.csv")
OLD_SEED, NEW_SEED = 46001, 46002
CASES = [("macaque", 2), ("macaque", 4), ("spiking_msprt", 2)]
BANDS = ((4, 10), (10, 20), (20, 35), (35, 60), (60, 100))
BATCH, READINGS, LEVEL = 4000, 40, -np.log(0.9)


def evidence(channels, first):
    """Return a batch of log posteriors of Gaussian readings, nats, with d' = 0.7."""
    rng = np.random.default_rng([46000, channels, first])
    readings = rng.normal(size=(BATCH, READINGS, channels))
    readings[..., 0] += 0.7
    total = 0.7 * readings.cumsum(axis=1)
    top = total.max(axis=-1, keepdims=True)
    return total - top - np.log(np.exp(total - top).mean(axis=-1, keepdims=True))


def decisions(name, channels, trials, seed):
    """Return the time, ms, and the choice of every trial at a posterior of 0.9."""
    circuit, times, choices = anatomy.load_circuit(name, channels), [], []
    for first in range(0, trials, BATCH):
        options = {"step_ms": 50.0, "seed": seed, "first_trial": first}
        options |= {"rates": False, "drop_below": LEVEL}
        activity = run(circuit, evidence(channels, first), engine="population", **options)
        out = activity.output_nats
        below = np.nanmin(out, axis=2, initial=np.inf) < LEVEL
        at = np.where(below.any(axis=1), below.argmax(axis=1), out.shape[1] - 1)
        times.append(activity.time_ms[at])
        choices.append(np.nan_to_num(out[np.arange(len(out)), at], nan=np.inf).argmin(axis=1))
    return np.concatenate(times), np.concatenate(choices)


def measures(name, channels, trials, spectra, seed):
    """Return the measures of a circuit, by name."""
    times, choices = decisions(name, channels, trials, seed)
    values = {"accuracy": (choices == 0).mean(), "mean_ms": times.mean(), "sd_ms": times.std()}
    values |= {f"q{q:02d}": np.quantile(times, q / 100) for q in range(5, 100, 5)}
    held = np.tile(
        0.4 * np.where(np.arange(channels) == 0, 1, -1 / (channels - 1)), (spectra, 4, 1)
    )
    circuit = anatomy.load_circuit(name, channels)
    activity = run(circuit, held, engine="population", step_ms=500.0, seed=seed)
    for nucleus in ("D2", "STN", "GPe", "SNr"):
        rates = activity.rates_hz[nucleus][:, 500:].astype(float).mean(axis=2)
        at, power = (np.asarray(part) for part in welch(rates, fs=1000, nperseg=500, axis=1))
        for low, high in BANDS:
            band = (at >= low) & (at < high)
            values[f"{nucleus} {low}-{high} Hz"] = power.mean(axis=0)[band].mean()
    return values


@pytest.fixture(scope="module", params=CASES, ids=str)
def both(request):
    """Return the measures of version 0.3.0, and those of today on as much evidence."""
    name, channels = request.param
    old = pd.read_csv(PATH).set_index(["circuit", "channels", "measure"])["value"]
    return old[name, channels], pd.Series(measures(name, channels, 20_000, 400, NEW_SEED))


def test_decisions_are_those_of_the_version_before(both):
    """Mean times within 0.5 %, accuracies within 0.005; quantiles within their own error."""
    old, new = both
    assert new["mean_ms"] == pytest.approx(old["mean_ms"], rel=0.005)
    assert new["sd_ms"] == pytest.approx(old["sd_ms"], rel=0.015)
    assert new["accuracy"] == pytest.approx(old["accuracy"], abs=0.005)
    places = np.arange(5, 100, 5)
    quantiles = [np.array([each[f"q{q:02d}"] for q in places]) for each in both]
    # The share of new trials below the old quantiles: Kolmogorov's distance, coarsely.
    shares = np.interp(quantiles[0], quantiles[1], places / 100)
    assert np.abs(shares - places / 100)[1:-1].max() < 1.63 * np.sqrt(2 / 20_000)


def test_spectra_are_those_of_the_version_before(both):
    """Within 5 % where each has an error of some 1 %, and 2 % on average."""
    old, new = both
    bands = [measure for measure in new.index if measure.endswith("Hz")]
    ratio = new[bands] / old[bands]
    assert (ratio - 1).abs().max() < 0.05
    assert ratio.mean() == pytest.approx(1, abs=0.02)


if __name__ == "__main__":
    rows = [
        {"circuit": name, "channels": channels, "measure": measure, "value": value}
        for name, channels in CASES
        for measure, value in measures(name, channels, 20_000, 400, OLD_SEED).items()
    ]
    pd.DataFrame(rows).to_csv(sys.argv[1] if len(sys.argv) > 1 else PATH, index=False)
