"""Trials of a person with known parameters, decided by the test or by the default circuit.

The test's are drawn from its density. The circuit decides trial by trial, with evidence and noise
that are independent of the stored trials of a fit.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from bgmodel.fitting.algorithms import GapModel
from bgmodel.fitting.design import Design
from bgmodel.fitting.responses import BIN_S, BinnedResponses, Grid
from bgmodel.fitting.simulated.circuit_model import NONE
from bgmodel.fitting.simulated.crossings import simulated
from circuits.arrays import Array, Integers
from figures.data.measure_fits import fitted_circuit

DEADLINE_S = 4.0
GRID = Grid(round(DEADLINE_S / BIN_S))
TRIALS = 16_000
"""Trials that a fitted circuit is simulated with, at each drift: the default of a fit."""
Values = Mapping[str, float]


def decided_by_test(
    values: Values, strengths: Sequence[float], each: int, rng: np.random.Generator
) -> tuple[Array, Integers]:
    """Return decision times, s, and choices (-1: none) of ``each`` trials at every strength."""
    one = {name: np.full(len(strengths), value) for name, value in values.items()}
    mass = GapModel().decided(one, np.array(strengths), GRID).reshape(len(strengths), -1)
    never = np.maximum(1 - mass.sum(axis=1), 0.0)
    shares = np.column_stack([mass, never]) / (mass.sum(axis=1) + never)[:, None]
    picked = np.concatenate([rng.choice(len(row), each, p=row) for row in shares])
    choice, bins = np.divmod(picked, GRID.bins)
    return (bins + rng.random(len(bins))) * BIN_S, np.where(choice == 2, -1, choice)


def decided_by_circuit(
    values: Values, strengths: Sequence[float], each: int, seed: int, rng: np.random.Generator
) -> tuple[Array, Integers]:
    """Return the same for the circuit, run on new evidence from a seed."""
    # It is run on new evidence: its stored trials, whose number matters to fits, are not used.
    model = fitted_circuit(NONE, TRIALS, DEADLINE_S)
    threshold = np.array([values["threshold_nats"]])
    crossings = simulated(
        replace(model, seed=seed).run((), float(threshold[0])), threshold, seconds=DEADLINE_S,
        trials=each, seed=seed, drifts=values["sensitivity"] * np.array(strengths),
    )  # fmt: skip
    # Evidence of positive drift speaks for channel 0, which is response 1 here.
    choice = np.where(crossings.choice[0] < 0, -1, 1 - crossings.choice[0])
    return (crossings.bins[0] + rng.random(len(choice))) * BIN_S, choice


def responses(
    values: Values,
    strengths: Sequence[float],
    decided: tuple[Array, Integers],
    rng: np.random.Generator,
) -> Design:
    """Return the trials with non-decision times and lapses; those after the deadline have none."""
    time_s, choice = decided
    cell = np.repeat(np.arange(len(strengths)), len(choice) // len(strengths))
    rt = time_s + rng.normal(values["t0_s"], values["t0_sd_s"], len(cell))
    lapse = rng.random(len(cell)) < values["lapse"]
    rt = np.where(lapse, rng.random(len(cell)) * DEADLINE_S, rt)
    choice = np.where(lapse, rng.integers(0, 2, len(cell)), choice)
    answered = (choice >= 0) & (rt > 0) & (rt < DEADLINE_S)
    seen = BinnedResponses(
        cell, np.where(answered, choice, -1), np.where(answered, rt, np.nan), GRID, DEADLINE_S
    )
    return Design(np.array(strengths), {}, seen)
