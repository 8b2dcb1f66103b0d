"""Training and scoring of the built-in network for the circuit's likelihood.

``python -m benchmarks.likelihood_network`` simulates the default circuit (the population engine, on
a training seed), trains the network with torch, scores it on a seed not used for training, and
writes it to ``bgmodel/data``, which takes minutes of CPU. ``--table FILE`` instead writes simulated
responses, one row per trial, for training other tools: parameters, rt and response.

The network learns log(density + floor) at drifts and thresholds of a lattice, at times 10 ms apart.
The points of each step are sampled mostly in proportion to the trials there, and otherwise
uniformly, so that regions with hardly any trials are also learned.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from bgmodel import stream
from bgmodel.fitting.responses import Grid, responded
from bgmodel.fitting.simulated.circuit_model import CircuitModel
from bgmodel.fitting.simulated.error import decided
from bgmodel.fitting.simulated.network import LikelihoodNetwork, shipped_path
from bgmodel.support.files import read_table, write_table
from circuits.arrays import Array
from circuits.declaration.table_writer import identity
from figures.data import measure_likelihood as score
from figures.pieces import run
from figures.rooms import OUT, table_path

TRAINING_SEED = 24_501
TRIALS = 60_000
"""Trials at each of the seven drifts."""
T0_SD_S, FLOOR_PER_S = 0.05, 1e-4
MOST_DRIFT, DRIFTS = 16.0, 33
T0_S = 0.3
"""Start of the lattice's times, before t0."""
BINS = 500
WIDTH, LAYERS = 64, 3
STEPS, BATCH, RATE = 14_000, 4096, 5e-3
EVENLY = 0.25
"""Share of a batch that is sampled uniformly."""
HUBER_NATS = 0.05
ROWS_PER_POINT = 1000


@dataclass(frozen=True)
class Lattice:
    """Densities of responses at thresholds, drifts and times.

    Parameters
    ----------
    thresholds_nats : array (thresholds,)
        Thresholds of the stored crossings, and their midpoints.
    drifts : array (drifts,), 1/sqrt(s)
        From 0 on.
    density : array (thresholds, drifts, 2, BINS), 1/s
        Of responses 0 and 1, with t0 of ``T0_S``.
    """

    thresholds_nats: Array
    drifts: Array
    density: Array

    @property
    def after_t0_s(self) -> Array:
        """Times after t0, (BINS,), s."""
        return Grid(BINS).middles_s - T0_S

    def features(self) -> Array:
        """Return the network's inputs, (points, 3), in the order of the densities."""
        signed = np.stack([-self.drifts, self.drifts], axis=1)
        parts = (
            signed[None, :, :, None],
            np.log(np.expm1(self.thresholds_nats))[:, None, None, None],
            self.after_t0_s,
        )
        return np.stack([np.broadcast_to(x, self.density.shape).ravel() for x in parts], axis=1)


def lattice(model: CircuitModel) -> Lattice:
    """Return the densities that the network learns."""
    stored, levels = model.stored(()), model.thresholds_nats
    thresholds = np.sort(np.concatenate([levels, (levels[1:] + levels[:-1]) / 2]))
    # Densities depend most on the drift where choices are least certain.
    drifts, grid = MOST_DRIFT * np.linspace(0, 1, DRIFTS) ** 1.5, Grid(BINS)
    shape = {"t0_s": T0_S, "t0_sd_s": T0_SD_S, "lapse": 0.0}
    everywhere = {name: np.full(DRIFTS, value) for name, value in shape.items()}
    decisions = (decided([(stored, 1.0)], float(nats), drifts, grid) for nats in thresholds)
    return Lattice(
        thresholds, drifts, np.stack([responded(each, grid, **everywhere) for each in decisions])
    )


def batches(weights: Array) -> Iterator[Array]:
    """Yield the points of each step."""
    rng = stream(TRAINING_SEED, "batches")
    summed = np.cumsum((1 - EVENLY) * weights / weights.sum() + EVENLY / len(weights))
    for _ in range(STEPS):
        drawn = np.searchsorted(summed, rng.random(BATCH) * summed[-1])
        yield np.minimum(drawn, len(weights) - 1)


def first_layers(torch: Any) -> Any:
    """Return an untrained network with broad initial weights."""
    torch.manual_seed(TRAINING_SEED)
    sizes = [3] + [WIDTH] * LAYERS
    parts: list[Any] = []
    for before, after in pairwise(sizes):
        parts += [torch.nn.Linear(before, after), torch.nn.Tanh()]
    with torch.no_grad():
        # Densities vary with time on a scale of 50 ms, with other inputs on that of their range.
        parts[0].weight.normal_(0.0, 1.5).mul_(torch.tensor([1.0, 1.0, 2.0]))
        parts[0].bias.uniform_(-2.0, 2.0)
    return torch.nn.Sequential(*parts, torch.nn.Linear(WIDTH, 1))


def trained(points: Lattice) -> tuple[tuple[Array, Array], ...]:
    """Return the layers after training."""
    import torch

    torch.set_num_threads(1)
    features, weights = points.features(), points.density.ravel()
    centre, scale = features.mean(axis=0), features.std(axis=0)
    inputs = torch.tensor((features - centre) / scale, dtype=torch.float32)
    wanted = torch.tensor(np.log(weights + FLOOR_PER_S), dtype=torch.float32)
    network = first_layers(torch)
    optimizer = torch.optim.Adam(network.parameters(), lr=RATE)
    schedule = torch.optim.lr_scheduler.OneCycleLR(
        optimizer, RATE, total_steps=STEPS, pct_start=0.05, final_div_factor=1000
    )
    for step, drawn in enumerate(batches(weights)):
        off = network(inputs[drawn])[:, 0] - wanted[drawn]
        loss = torch.nn.functional.huber_loss(off, torch.zeros_like(off), delta=HUBER_NATS)
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
        schedule.step()
        if step % 2000 == 1999:
            print(f"step {step + 1}: {off.detach().abs().mean():.4f} nats", flush=True)
    linear = [part for part in network if isinstance(part, torch.nn.Linear)]
    layers = [
        (p.weight.detach().double().numpy().T, p.bias.detach().double().numpy()) for p in linear
    ]
    weights, bias = layers[0]
    layers[0] = (weights / scale[:, None], bias - (centre / scale) @ weights)
    return tuple(layers)


def about(model: CircuitModel) -> dict[str, Any]:
    """Return the network's metadata before it is scored."""
    low, high = float(model.thresholds_nats[0]), float(model.thresholds_nats[-1])
    known = {"circuit": identity(model.circuit), "engine": model.engine, "trials": 7 * model.trials}
    return {
        **known,
        "noise_nats": model.noise_nats,
        "training_seed": model.seed,
        "t0_sd_s": T0_SD_S,
        "floor_per_s": FLOOR_PER_S,
        "bounds": {"v": [-MOST_DRIFT, MOST_DRIFT], "threshold": [low, high], "t0": [0.05, 1.5]},
        "rt_after_t0_s": [-T0_S, round(BINS / 100 - T0_S, 2)],
    }


def responses(points: Lattice) -> pd.DataFrame:
    """Return simulated responses at random points of the lattice, one row per trial."""
    rng, parts = stream(TRAINING_SEED, "responses"), []
    for k, nats in enumerate(points.thresholds_nats):
        for j, drift in enumerate(points.drifts):
            mass = points.density[k, j].ravel()
            drawn = rng.choice(2 * BINS, ROWS_PER_POINT, p=mass / mass.sum())
            t0 = rng.uniform(0.1, 0.6, ROWS_PER_POINT)
            sign = rng.choice([-1, 1], ROWS_PER_POINT)
            time = points.after_t0_s[drawn % BINS] + rng.uniform(-0.005, 0.005, ROWS_PER_POINT)
            columns = {"v": sign * drift, "threshold": nats, "t0": t0, "rt": time + t0}
            parts.append(pd.DataFrame(columns | {"response": sign * np.where(drawn < BINS, -1, 1)}))
    return pd.concat(parts, ignore_index=True)


def main() -> None:
    """Train, score and write the network, or write the requested table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--table", type=Path, help="write simulated responses, a .parquet, alone")
    options = parser.parse_args()
    model = score.model_of(TRIALS, TRAINING_SEED)
    points = lattice(model)
    if options.table:
        known = {**about(model), "rows_per_point": ROWS_PER_POINT}
        write_table(responses(points), options.table, seed=TRAINING_SEED, **known)
        return
    network = LikelihoodNetwork(trained(points), about(model))
    network.write(shipped_path())
    run(score.SCORE, list(score.pieces(False, 1)), OUT, False, "")
    errors = read_table(table_path("likelihood_network"))
    measured = {"error_nats": round(float(errors["error_nats"].mean()), 5)}
    measured["simulation_error_nats"] = round(float(errors["noise_nats"].mean()), 5)
    scored = {**network.about, **measured, "scoring_seed": score.SCORING_SEED}
    replace(network, about=scored).write(shipped_path())


if __name__ == "__main__":
    main()
