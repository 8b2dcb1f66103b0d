"""The threshold and the gain of a circuit, chosen by its decisions on trials kept for that."""

from __future__ import annotations

import numpy as np

from bgmodel.deciding.tradeoff import Tradeoff, curve, time_at, tradeoff
from bgmodel.evidence import Evidence
from bgmodel.integrators.basal_ganglia import BasalGanglia
from bgmodel.integrators.deciding import (
    CIRCUIT,
    decide_at_thresholds,
    thresholds_of,
    without_noise_alone,
)
from bgmodel.integrators.sprt import Msprt
from circuits.circuit import Circuit
from circuits.engines import Engine
from circuits.errors import InputError

GAINS = (0.05, 0.1, 0.2, 0.4, 0.8)
"""Gains that are tried for a circuit that does not work in nats."""
ACCURACY = 0.9
"""The gain is that at which this accuracy is reached fastest."""


def swept(model: BasalGanglia, evidence: Evidence, test: Tradeoff | None = None) -> Tradeoff:
    """Return a circuit's decisions at thresholds that noise at rest hardly ever crosses."""
    test = tradeoff(Msprt(model.gain).run(evidence), evidence) if test is None else test
    levels = without_noise_alone(model, thresholds_of(model.circuit, test))
    if not levels.size:
        raise InputError(
            f"noise alone takes {model.circuit.name} below every threshold within half a second",
            "circuit",
        )
    return decide_at_thresholds(model, evidence, levels, decoder_tau_ms=None)[CIRCUIT]


def fastest_gain(
    circuit: Circuit,
    engine: Engine | str,
    evidence: Evidence,
    seed: int,
    gain: float | None = None,
) -> tuple[BasalGanglia, Tradeoff]:
    """Return a circuit at its gain, and its decisions at many thresholds.

    A circuit has its default gain, adapted to the evidence, or 1 if it is exact. One without is
    given the gain of ``GAINS`` at which it reaches ``ACCURACY`` fastest on this evidence.
    """
    known = gain is not None or circuit.default_gain is not None
    known |= (circuit.unedited or circuit).exact
    gains = (gain,) if known else GAINS
    once = np.ones((1, evidence.trials))
    tried: list[tuple[float, BasalGanglia, Tradeoff]] = []
    refused: list[ValueError] = []
    for each in gains:
        model = BasalGanglia(circuit, engine, each, seed)  # type: ignore[arg-type]
        model = model.adapted_to(evidence)
        try:
            decided = swept(model, evidence)
        except ValueError as error:
            refused.append(error)
            continue
        tried.append((float(time_at([ACCURACY], curve(decided, once))[0, 0]), model, decided))
    if not tried:
        raise refused[0]
    _, model, decided = min(tried, key=lambda one: np.inf if np.isnan(one[0]) else one[0])
    return model, decided
