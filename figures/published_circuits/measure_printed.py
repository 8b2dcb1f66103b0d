"""Published numbers of published circuits, and those of their tables, as a check.

Intervals are those of a mean over seeds, each with different connections. Exact values have none.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import pandas as pd
from scipy.stats import t

from bgmodel import stream
from circuits import anatomy
from circuits.arrays import Array
from circuits.engines import run
from figures.pieces import Made, Piece, Score

SCORING_SEED = 77_001
SEEDS, COARSE_SEEDS = 10, 3
TRIALS, SETTLED_MS, STEP_MS, STEPS = 3, 300, 100, 10
PARS = "authors' code, pars.m"


def over_seeds(values: Array) -> dict[str, float]:
    """Return a mean over seeds with its 95 % interval (Student t)."""
    half = t.ppf(0.975, len(values) - 1) * values.std(ddof=1) / np.sqrt(len(values))
    return {"value": values.mean(), "low": values.mean() - half, "high": values.mean() + half}


def humphries(seeds: int) -> Iterator[dict[str, Any]]:
    """Yield tonic rates."""
    circuit = anatomy.humphries(3)
    rest = np.zeros((TRIALS, STEPS, 3))
    rates: dict[str, list[float]] = {"GPe": [], "SNr": [], "STN": []}
    for seed in range(seeds):
        wired = replace(circuit, wiring_seed=seed)
        activity = run(wired, rest, engine="spikes", step_ms=STEP_MS, seed=SCORING_SEED + seed)
        for name, values in rates.items():
            values.append(activity.rates_hz[name][:, SETTLED_MS:].mean())
    for name, printed in (("GPe", "30"), ("SNr", "30"), ("STN", "12")):
        what = f"rate of {name} at rest, Hz"
        yield {"what": what, "printed": printed, "where": PARS, **over_seeds(np.array(rates[name]))}


def stewart(seeds: int) -> Iterator[dict[str, Any]]:
    """Yield the time until a channel is silent."""
    drive = np.tile(np.repeat([[0.0, 0, 0], [1.0, 0, 0]], 400, axis=0), (50, 1, 1))
    late = []
    for seed in range(seeds):
        settings = {
            "engine": "spikes",
            "step_ms": 0.5,
            "sample_ms": 0.5,
            "seed": SCORING_SEED + seed,
        }
        rate = run(anatomy.stewart(3), drive, **settings).rates_hz["SNr"][:, 400:, 0].mean(axis=0)
        late.append(0.5 * ((rate < 1).argmax() + 1))
    what = "time from a step of 1 until SNr's mean rate is below 1 Hz, ms"
    yield {"what": what, "printed": "14", "where": "abstract", **over_seeds(np.array(late))}


def exact(seeds: int) -> Iterator[dict[str, Any]]:
    """Yield exact values: OUT of Bogacz & Gurney, and the resting state of Gurney et al."""
    y = stream(SCORING_SEED, "printed").normal(0, 1, (200, 1, 4))
    y -= y.mean(axis=2, keepdims=True)
    out = run(anatomy.bogacz_gurney(4), y, engine="algebra", step_ms=1.0).output_nats[:, 0]
    posterior = np.exp(y[:, 0]) / np.exp(y[:, 0]).sum(axis=1, keepdims=True)
    off = np.abs(out + np.log(posterior)).max()
    what = "OUT + ln P, the farthest from 0 of 200 drives, four channels"
    where = "equations of section 3"
    yield {"circuit": "bogacz_gurney", "what": what, "printed": "0", "where": where, "value": off}
    # STN: S = 6 (0.25 - GPe), GPe = 0.9 S + 0.2; SNr = 0.9 S - 0.3 GPe + 0.2.
    total = 0.3 / 6.4
    by_hand = 0.9 * total - 0.3 * (0.9 * total + 0.2) + 0.2
    rest = run(anatomy.gpr(6), np.zeros((1, 1, 6)), engine="algebra", step_ms=1.0).output_nats
    what = "output at rest, six channels"
    printed = f"{by_hand:.6f}".lstrip("0")
    where = "equations, solved by hand"
    value = float(rest.mean())
    yield {"circuit": "gpr", "what": what, "printed": printed, "where": where, "value": value}


def rows(name: str, seeds: int) -> pd.DataFrame:
    """Return published numbers of a circuit and those of its table."""
    made = {"humphries": humphries, "stewart": stewart, "exact": exact}[name]
    return pd.DataFrame([{"circuit": name, "seeds": seeds} | row for row in made(seeds)])


def pieces(fast: bool, workers: int) -> Iterator[Piece]:
    """Yield a piece per circuit; threads are not used."""
    seeds = COARSE_SEEDS if fast else SEEDS
    for name in ("exact", "humphries", "stewart"):
        yield Piece("numbers", name, seeds, 10 * seeds, partial(rows, name, seeds))


def tables(made: Made) -> dict[str, tuple[str, pd.DataFrame]]:
    """Return the numbers unchanged."""
    ends = {"low": "value_low", "high": "value_high"}
    return {"numbers": ("numbers", made["numbers"].rename(columns=ends))}


PRINTED = ("bogacz_gurney", "gpr", "humphries", "stewart")
SCORE = Score("printed", SCORING_SEED, (4,), pieces, tables, circuit="", others=PRINTED)
