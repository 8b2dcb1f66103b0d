"""The whole chain, scored: taps in, reward out: make score.

For 20 seeds each: the level of dopamine that a circuit learns on gratings, and decisions of test,
populations and spikes at what reward taught them, on shipped taps and on recordings.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import cache, partial

import numpy as np
import pandas as pd

from bgmodel import stream
from bgmodel.evidence import Evidence
from bgmodel.from_taps import T_MAX, chain
from bgmodel.integrators.at_thresholds import CIRCUIT
from bgmodel.integrators.basal_ganglia import BasalGanglia
from bgmodel.integrators.sprt import Msprt
from bgmodel.learning.dopamine_learner import TEST
from bgmodel.learning.from_reward import learn
from bgmodel.learning.reinforce import Learner
from bgmodel.tactile.recordings import find_recordings
from bgmodel.tactile.source import Folds, decoded_edges, folds, held_out_taps
from bgmodel.tactile.task import EdgeTurn, SameDifferent
from circuits.anatomy import DEFAULT, load_circuit
from circuits.engines import Populations, Rates
from circuits.errors import quiet
from figures.pieces import Made, Piece, Score

SCORING_SEED, SEEDS, COARSE_SEEDS = 40_011, 20, 2
PERIODS_MM = (1.0, 1.5, 2.0, 2.5)
CHAINS = ("1.5 mm", "2 mm", "edge, recorded")
"""Taps on which reward sets the criterion of test and circuit."""
TURN_DEG = 5.0
TRIALS, SPIKING, FOLDS, STEP_MS = 1200, 240, 12, 50.0
SECONDS = {"told": 1.0, "levels": 25.0, "learned": 60.0}
"""CPU time of a seed, about."""
BY = ["part", "taps", "who", "measure"]


@cache
def readings(taps: str) -> Folds:
    """Return the readings of shipped taps of a grating, or of recorded taps of an edge."""
    if taps.endswith("mm"):
        return folds(held_out_taps(), SameDifferent(float(taps.split()[0])), FOLDS)
    return folds(recorded(), EdgeTurn(2, step_deg=TURN_DEG), FOLDS)


def recorded() -> pd.DataFrame:
    """Return decoded taps of recordings: BGMODEL_RECORDINGS names their folder."""
    folder = find_recordings(None)
    if folder is None:
        raise ValueError("recorded taps are needed: set BGMODEL_RECORDINGS")
    return decoded_edges(SCORING_SEED, folder)


def told(taps: str, seed: int) -> pd.DataFrame:
    """Return the accuracy of the test that uses all readings of a trial."""
    evidence = readings(taps).draw(TRIALS, T_MAX, rng=stream(seed, "chain, told"), step_ms=STEP_MS)
    accuracy = float(Msprt().decide(evidence, posterior=1 - 1e-9).accuracy)
    return pd.DataFrame([{"who": TEST, "measure": "accuracy", "value": accuracy}])


def levels(taps: str, seed: int) -> pd.DataFrame:
    """Let the circuit learn its level, as ``bgmodel learn`` does; return measures."""
    task = SameDifferent(float(taps.split()[0]), t_max=T_MAX)
    model = BasalGanglia(load_circuit(DEFAULT, 2), Rates().coarse())
    outcome = learn(task, model, seed=seed)
    values = {
        "level": outcome.learned.mean(), "best_level": outcome.best, "regret": outcome.regret,
        "start_regret": outcome.regrets.loc["start", "value"],
    }  # fmt: skip
    return pd.DataFrame(values.items(), columns=["measure", "value"]).assign(who=CIRCUIT)


def learned(taps: str, seed: int) -> pd.DataFrame:
    """Return decisions of test, populations and spikes with what each learned from reward."""
    source = readings(taps)
    evidence = source.draw(TRIALS, T_MAX, rng=stream(seed, "chain, learned"), step_ms=STEP_MS)
    outcome = chain(source, _model(evidence, seed), evidence, Learner(), seed, 1, SPIKING)
    return outcome.learned


def _model(evidence: Evidence, seed: int) -> BasalGanglia:
    return BasalGanglia(load_circuit(DEFAULT, 2), Populations(), seed=seed).adapted_to(evidence)


def over_seeds(make: Callable[[str, int], pd.DataFrame], taps: str, seeds: int) -> pd.DataFrame:
    """Return the measures of every seed."""
    rows = []
    with quiet():
        for seed in range(SCORING_SEED, SCORING_SEED + seeds):
            rows.append(make(taps, seed).assign(part=make.__name__, taps=taps, seed=seed))
    return pd.concat(rows)[[*BY, "seed", "value"]]


def pieces(fast: bool, workers: int) -> Iterator[Piece]:
    """Yield a piece per part and kind of taps."""
    seeds = COARSE_SEEDS if fast else SEEDS
    gratings = [f"{period:g} mm" for period in PERIODS_MM]
    some = gratings[1:]  # the finest holds nothing to decide by
    wanted = {told: [*gratings, CHAINS[-1]], levels: some, learned: CHAINS}
    for make, taps in wanted.items():
        for name in taps:
            seconds = SECONDS[make.__name__] * seeds
            run = partial(over_seeds, make, name, seeds)
            yield Piece("rows", f"{make.__name__} {name}", TRIALS, seconds, run)


def tables(made: Made) -> dict[str, tuple[str, pd.DataFrame]]:
    """Return the mean of each measure over seeds, its 95 % interval and its range."""
    by = made["rows"].groupby(BY, sort=False)["value"]
    means = by.agg(seeds="count", value="mean", least="min", most="max").reset_index()
    width = (1.96 * by.std() / np.sqrt(by.count())).to_numpy()
    means["value_low"], means["value_high"] = means["value"] - width, means["value"] + width
    return {"rows": ("rows", means)}


SCORE = Score("chain", SCORING_SEED, (2,), pieces, tables, circuit=DEFAULT)
