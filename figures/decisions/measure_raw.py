"""The default circuit on raw evidence, with the noise ceiling: make score.

Each channel receives its own evidence. For comparison: chance, and the circuit with other noise
(the noise ceiling). Populations decide on every kind of evidence; spikes on all but one, together
with a decoder of their cortical spikes. Evaluated on held-out seeds.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import partial

import pandas as pd

from bgmodel.comparison.compare import compare
from bgmodel.comparison.matched import ACCURACIES, OTHER_NOISE
from bgmodel.comparison.thresholds import MSPRT_AT_GAIN
from bgmodel.integrators.at_thresholds import CIRCUIT, sample_ms
from bgmodel.integrators.basal_ganglia import BasalGanglia
from bgmodel.integrators.criterion import gain_of
from circuits.anatomy import DEFAULT, load_circuit
from circuits.engines import engine_of
from figures.decisions.kinds import SCORING_SEED, Kind, drawn, groups_of, kinds
from figures.pieces import Made, Piece, Score, wide

TRIALS, COARSE_TRIALS, SPIKING_TRIALS, COARSE_SPIKING = 5000, 1000, 1000, 200
SLOW, SLOW_MS, SLOW_TRIALS = "8 orientations, 2 mm", 500.0, 1000
"""Evidence that no circuit of spikes reads 20 times a second is read twice a second too."""
LOWER = (0.8, 0.85, 0.9)
"""Accuracies that are reached on it: its likelihoods are too sure for more."""
FASTER, SLOWER = 60, 8
"""Times that populations are faster than spikes in ``kinds``, and this table is slower."""
MEASURES = ("agreement", "within_50_ms", "pearson_r", "extra_ms")
OF_DECODER = ("agreement", "pearson_r")
"""What is shown of the decoder of cortex."""


def decisions(
    kind: Kind,
    engine: str,
    trials: int,
    workers: int,
    *,
    step_ms: float = 50.0,
    accuracies: Sequence[float] = ACCURACIES,
) -> pd.DataFrame:
    """Return the comparison of the circuit on a kind of evidence."""
    table = load_circuit(DEFAULT, kind.channels)
    chosen = engine_of(engine, workers=workers, sample_ms=sample_ms(step_ms))
    model = BasalGanglia(table, chosen, gain_of(table), SCORING_SEED)
    comparison = compare(
        model,
        drawn(kind, trials, step_ms),
        seed=SCORING_SEED,
        baselines=(),
        noise_ceiling=True,
        groups=groups_of(kind.name, trials),
        accuracies=accuracies,
    ).table
    name = kind.name if step_ms == 50.0 else f"{kind.name}, every {step_ms:g} ms"
    return comparison.assign(evidence=name, engine=engine, trials=trials)


def pieces(fast: bool, workers: int) -> Iterator[Piece]:
    """Yield populations on every kind of evidence, and spikes on all but one."""
    trials = COARSE_TRIALS if fast else TRIALS
    for kind in kinds():
        make = partial(decisions, kind, "population", trials, workers)
        name = f"{kind.name}, population"
        # Most of it is the bootstrap.
        seconds = kind.seconds * trials / 100 * SLOWER / FASTER + trials / 70
        yield Piece("decisions", name, trials, seconds, make)
        if kind.name == SLOW:
            if not fast:
                make = partial(
                    decisions, kind, "population", SLOW_TRIALS, workers,
                    step_ms=SLOW_MS, accuracies=LOWER,
                )  # fmt: skip
                seconds = 0.3 * SLOW_TRIALS
                yield Piece("decisions", f"{name}, every 500 ms", SLOW_TRIALS, seconds, make)
        else:
            few = COARSE_SPIKING if fast else SPIKING_TRIALS
            make = partial(decisions, kind, "spikes", few, workers)
            seconds = kind.seconds * few / 100 * SLOWER
            yield Piece("decisions", f"{kind.name}, spikes", few, seconds, make)


def tables(made: Made) -> dict[str, tuple[str, pd.DataFrame]]:
    """Return a row per evidence, engine and accuracy; and rows of the decoder."""
    rows = made["decisions"]
    rows = rows[rows["accuracy"].notna()]
    against_test = rows["reference"] == MSPRT_AT_GAIN
    of_circuit = rows["model"] == CIRCUIT
    decoder = rows[against_test & ~of_circuit & (rows["engine"] == "spikes")]
    decoder = decoder[decoder["measure"].isin(OF_DECODER)]
    decoder = decoder.assign(measure="decoder_" + decoder["measure"])
    kept = rows[against_test & of_circuit & rows["measure"].isin([*MEASURES, "agreement_chance"])]
    self = rows[(rows["reference"] == OTHER_NOISE) & of_circuit & (rows["measure"] == "pearson_r")]
    both = pd.concat([kept, self.assign(measure="ceiling_pearson_r")])
    return {
        "decisions": ("decisions", wide(both, ["evidence", "engine", "trials", "accuracy"])),
        "decoder": ("decisions", wide(decoder, ["evidence", "trials", "accuracy"])),
    }


SCORE = Score("raw", SCORING_SEED, (2, 4, 8), pieces, tables, circuit=DEFAULT)
