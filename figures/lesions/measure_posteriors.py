"""Behaviour of the default circuit by posterior, and after losses: make score.

For users who write an experiment: accuracy, time and late trials at each posterior, and their
values after loss of STN or GPe. With populations, two alternatives and the default gain.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

import numpy as np
import pandas as pd

from bgmodel import stream
from bgmodel.integrators.at_thresholds import CIRCUIT, decide_at_thresholds
from bgmodel.integrators.basal_ganglia import BasalGanglia
from bgmodel.integrators.criterion import gain_of
from bgmodel.integrators.sprt import threshold_from_posterior
from bgmodel.simulated_evidence import gaussian_evidence
from circuits.anatomy import DEFAULT, load_circuit
from circuits.circuit import Circuit
from circuits.engines import Populations
from figures.pieces import Piece, Score

SCORING_SEED = 78_001
TRIALS, COARSE_TRIALS = 5000, 200
READINGS, STEP_MS, D_PRIME = 240, 50.0, 0.5
LATE_MS = 60 * STEP_MS
"""A time that is called late: an experiment would need more readings than this."""
ASKED = (0.6, 0.7, 0.75, 0.8, 0.82, 0.85, 0.9, 0.93)
"""Posteriors at which the unedited circuit is evaluated."""
AT = 0.82
"""What experiments decide at unless they say another."""
LOST = (0.05, 0.1, 0.15, 0.2, 0.3, 0.5)
LESS_GPE = ((0.2, 0.7, None), (0.25, 0.7, None), (0.25, 0.6, None), (0.25, 0.6, 0))
"""Share of GPe that is lost, a lower posterior, and the channel if it is lost in one."""
SECONDS = 0.0015
"""CPU time of a trial of a circuit, about."""


def cases() -> Iterator[tuple[str, Circuit, tuple[float, ...]]]:
    """Yield the share lost, the circuit after the loss, and its posteriors."""
    table = load_circuit(DEFAULT)
    yield "nothing", table, ASKED
    for name in ("STN", "GPe"):
        for share in LOST:
            yield f"{name} {share:.0%}", table.lesion(name, share), (AT,)
    for share, posterior, channel in LESS_GPE:
        where = "GPe" if channel is None else f"GPe[{channel}]"
        yield f"{where} {share:.0%}", table.lesion("GPe", share, channel=channel), (posterior,)


def behaviour(trials: int, workers: int) -> pd.DataFrame:
    """Return accuracy, times and late trials of each circuit at its posteriors, same trials."""
    rng = stream(SCORING_SEED, "posteriors")
    evidence = gaussian_evidence(trials, d_prime=D_PRIME, t_max=READINGS, step_ms=STEP_MS, seed=rng)
    rows = []
    for lost, table, asked in cases():
        gain, engine = gain_of(load_circuit(DEFAULT)), Populations(workers=workers)
        model = BasalGanglia(table, engine, gain, SCORING_SEED)
        levels = threshold_from_posterior(asked)
        decisions = decide_at_thresholds(model, evidence, levels, decoder_tau_ms=None)[CIRCUIT]
        for k, out_nats in enumerate(decisions.settings):
            decided = ~decisions.forced[k]
            time_ms, choice = pd.Series(decisions.time_ms[k]), pd.Series(decisions.choice[k])
            rows.append(
                {
                    "lost": lost,
                    "posterior": float(np.exp(-out_nats)),
                    "trials": trials,
                    "accuracy": (choice == evidence.truth)[decided].mean(),
                    "mean_ms": time_ms[decided].mean(),
                    "late": (~decided | (time_ms > LATE_MS)).mean(),
                    "missed": 1 - decided.mean(),
                    "premature": decisions.premature[k].mean(),
                    "choice_0": (choice == 0)[decided].mean(),
                }
            )
    return pd.DataFrame(rows)


def pieces(fast: bool, workers: int) -> Iterator[Piece]:
    """Yield one piece."""
    trials = COARSE_TRIALS if fast else TRIALS
    make = partial(behaviour, trials, workers)
    yield Piece("behaviour", "all", trials, SECONDS * trials * len(list(cases())), make)


SCORE = Score("posteriors", SCORING_SEED, (2,), pieces, circuit=DEFAULT)
