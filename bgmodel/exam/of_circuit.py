"""Measures of the exam that need the circuit, or the optimal test on the exam's evidence."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pandas as pd

from bgmodel.bootstrap import Z95
from bgmodel.comparison import designed as designs
from bgmodel.comparison.compare import with_other_noise
from bgmodel.comparison.matched import matched_measures
from bgmodel.deciding.tradeoff import curve, time_at, tradeoff
from bgmodel.exam.measures import Estimate, Results, check_cells, hick_slope, measure
from bgmodel.exam.numbers import READINGS
from bgmodel.exam.simulation import Simulation, drawn
from bgmodel.exam.tables import Failed, NotApplicable, rows_of
from bgmodel.integrators.at_thresholds import CIRCUIT, decide_at_thresholds
from bgmodel.integrators.sprt import Msprt
from bgmodel.support.seeds import stream
from bgmodel.task import Gaussian
from circuits.arrays import Array
from circuits.circuit import Circuit
from circuits.declaration.rows import GLUTAMATE, SYNAPSES, Projection
from circuits.dynamics.fixed_point import rest, wired
from circuits.errors import quiet, require
from circuits.laws.fluctuation import rate_spectrum
from circuits.store import once

FREQUENCIES_HZ = np.arange(4.0, 60.25, 0.25)
BETA_HZ = (8.0, 30.0)
COMPARED = 1000
"""Trials of a comparison with the optimal test."""
BEYOND = 0.05
"""Thresholds are tried up to this much above the accuracy of a comparison."""
RESAMPLES = 200
DESIGNED = 40
SHARES = {"AMPA": 2 / 3, "NMDA": 1 / 3}
"""Shares of charge where a pathway does not declare its receptor.

Lienard & Girard (2014): potentials of 1 and 0.025 mV with half-times of 5 and 100 ms.
"""


# ---- rates at rest


@measure("Hz")
def blocked(results: Results, nucleus: str, receptors: str) -> Estimate:
    """Return the resting rate of cells whose receptors are blocked while all other cells rest, Hz.

    An antagonist next to a recorded cell acts on few cells, so that what they receive stays as it
    was. A pathway whose receptor is not declared acts through ``SHARES`` of AMPA and NMDA, or
    through GABA-A.
    """
    circuit = results.simulation.circuit(2).steady
    check_cells(results, nucleus)
    names = rows_of(nucleus, {row.name for row in circuit.populations})
    if not names:
        raise NotApplicable(f"there is no nucleus {nucleus}")
    chosen = {name.strip() for name in receptors.split(",")}
    must = f"must be among {', '.join(SYNAPSES)}"
    require(chosen <= {*SYNAPSES}, "receptors", must, receptors)
    wiring = wired(circuit)
    at_rest = wiring.deliver @ wiring.rates(rest(wiring)) + wiring.constant
    open_to = np.ones(wiring.units)
    for unit, p in enumerate(wiring.projections):
        if p.target in names:
            open_to[unit] = sum(x for name, x in _shares(circuit, p).items() if name not in chosen)
    if (open_to == 1).all():
        raise NotApplicable(f"{nucleus} has none of the receptors {receptors}")
    # A linear pathway transmits deviations from its source's tone, which is lost as well.
    linear = np.array([p.transfer == "linear" for p in wiring.projections])
    tone = wiring.weight @ (wiring.constant * linear * (1 - open_to))
    alone = wiring.rates(wiring.inputs(at_rest, open_to) + tone)
    here = np.concatenate([wiring.blocks_of(name) for name in names])
    return Estimate(float(alone[here].mean()), 0.0, 0)


def _shares(circuit: Circuit, p: Projection) -> dict[str, float]:
    """Return the receptors through which a pathway acts, with their shares of its charge."""
    if p.synapse:
        return {p.synapse: 1.0}
    excites = circuit.population(p.source).transmitter == GLUTAMATE
    return SHARES if excites else {"GABA-A": 1.0}


# ---- rhythms


def _power(circuit: Circuit, nucleus: str) -> Array:
    """Return the power of a nucleus at ``FREQUENCIES_HZ``, Hz^2/Hz, mean of its populations."""
    names = rows_of(nucleus, {row.name for row in circuit.populations})
    if not names:
        raise NotApplicable(f"there is no nucleus {nucleus}")
    if not any(circuit.population(name).spiking for name in names):
        raise NotApplicable(f"the activity of {nucleus} is abstract and has no noise of cells")
    try:
        power = [rate_spectrum(circuit, name, FREQUENCIES_HZ) for name in names]
    except ValueError as error:
        raise NotApplicable(str(error)) from None
    return np.asarray(np.mean(power, axis=0))


def _depleted(results: Results, level: float) -> tuple[Circuit, Circuit]:
    circuit = results.simulation.circuit(2).steady
    if not circuit.receptors():
        raise NotApplicable("no row has a receptor: dopamine has no effect")
    return circuit, circuit.dopamine(level)


@measure("Hz")
def beta_peak(results: Results, nucleus: str, dopamine: float) -> Estimate:
    """Return the frequency of the highest peak of the spectrum at a level of dopamine, Hz."""
    _, low = _depleted(results, dopamine)
    power = _power(low, nucleus)
    inner = np.flatnonzero((power[1:-1] > power[:-2]) & (power[1:-1] >= power[2:])) + 1
    if not inner.size:
        raise Failed(f"the spectrum of {nucleus} has no peak between 4 and 60 Hz")
    return Estimate(float(FREQUENCIES_HZ[inner[power[inner].argmax()]]), 0.0, 0)


@measure()
def beta_power(results: Results, nucleus: str, dopamine: float, minus: str = "") -> Estimate:
    """Return the log of the power from 8 to 30 Hz at a level of dopamine over the usual one.

    With ``minus``, less that of another nucleus.
    """
    usual, low = _depleted(results, dopamine)
    band = (BETA_HZ[0] <= FREQUENCIES_HZ) & (BETA_HZ[1] >= FREQUENCIES_HZ)

    def rise(name: str) -> float:
        before, after = _power(usual, name)[band].sum(), _power(low, name)[band].sum()
        if not (before > 0 and after > 0):
            raise NotApplicable(f"{name} is silent, or has no noise")
        return float(np.log(after / before))

    return Estimate(rise(nucleus) - (rise(minus) if minus else 0.0), 0.0, 0)


# ---- the optimal test


@once
def compared(simulation: Simulation, channels: int, accuracy: float) -> pd.DataFrame:
    """Return the comparison of a circuit with the MSPRT at an accuracy."""
    simulation.level(channels, accuracy)
    model, tuned = simulation.tuned(channels)
    count = max(200, round(simulation.share * COMPARED))
    evidence = drawn(Gaussian(channels, t_max=READINGS), count, simulation.seed, "compared")
    levels = tuned.settings[tuned.posterior.mean(axis=1) <= accuracy + BEYOND]
    test = tradeoff(Msprt().run(evidence), evidence, accuracies=(accuracy,))
    with quiet():
        decided = decide_at_thresholds(model, evidence, levels, decoder_tau_ms=None)[CIRCUIT]
        again = with_other_noise(model, evidence, decided) if model.engine.noisy else None
        return matched_measures(
            test, decided, rng=stream(simulation.seed, "exam", "bootstrap"),
            truth=evidence.truth, again=again, accuracies=(accuracy,), resamples=RESAMPLES,
        )  # fmt: skip


def _measured(table: pd.DataFrame, name: str) -> tuple[float, float]:
    """Return a measure of a comparison, and its standard error from the interval."""
    rows = table[table["measure"] == name]
    if rows.empty or not np.isfinite(rows["value"].iloc[0]):
        raise Failed("the circuit and the optimal test have no accuracy in common")
    row = rows.iloc[0]
    return float(row["value"]), float((row["high"] - row["low"]) / (2 * Z95))


@measure()
def agreement(results: Results, channels: float, accuracy: float) -> Estimate:
    """Return the share of trials with the MSPRT's choice, beyond chance."""
    table = compared(results.simulation, int(channels), accuracy)
    same, se = _measured(table, "agreement")
    chance, _ = _measured(table, "agreement_chance")
    return Estimate((same - chance) / (1 - chance), se / (1 - chance), COMPARED)


@measure()
def time_correlation(results: Results, channels: float, accuracy: float) -> Estimate:
    """Return r of decision times with the MSPRT's, over the largest that the noise allows."""
    table = compared(results.simulation, int(channels), accuracy)
    noisy = (table["measure"] == "r_noise_corrected").any()
    return Estimate(*_measured(table, "r_noise_corrected" if noisy else "pearson_r"), COMPARED)


@measure("ms")
def extra_time(results: Results, channels: float, accuracy: float) -> Estimate:
    """Return the mean decision time less that of the MSPRT at equal accuracy, ms."""
    table = compared(results.simulation, int(channels), accuracy)
    return Estimate(*_measured(table, "extra_ms"), COMPARED)


@measure("ms")
def designed(results: Results, channels: float, accuracy: float) -> Estimate:
    """Return the largest difference of crossing times from the MSPRT on designed trials, ms.

    Courses are left out: they may bring a crossing forward whatever the evidence.
    """
    simulation = results.simulation
    level = simulation.level(int(channels), accuracy)
    model, _ = simulation.tuned(int(channels))
    try:
        with quiet():
            model = replace(model, circuit=model.circuit.steady)
            table = designs.designed_circuit(model, [level], trials=DESIGNED)
    except ValueError as error:
        raise Failed(str(error)) from None
    rows = table[(table["theory"] == designs.MSPRT) & (table["held"] != "")]
    if rows["value"].isna().any():
        raise Failed("it does not choose the leader in nine of ten designed trials")
    row = rows.iloc[int(rows["value"].abs().to_numpy().argmax())]
    return Estimate(
        abs(float(row["value"])), float((row["high"] - row["low"]) / (2 * Z95)), DESIGNED
    )


@measure()
def hick_ratio(results: Results, tasks: str) -> Estimate:
    """Return the slope of the mean time over ln N, divided by that of the MSPRT."""
    slope = hick_slope(results, tasks)
    x, best = [], []
    for name in tasks.split(","):
        task = results.tasks[name.strip()]
        evidence = drawn(task, task.trials, results.seed)
        swept = tradeoff(Msprt().run(evidence), evidence)
        once = np.ones((1, evidence.trials))
        x.append(np.log(task.channels))
        best.append(time_at([task.accuracy], curve(swept, once))[0, 0])
    optimal = float(np.polyfit(x, best, 1)[0])
    return Estimate(slope.value / optimal, slope.se / optimal, slope.trials)
