"""What keeps the circuit's decision times from the MSPRT's, on the scoring seed: make score.

The circuit as it is, beside itself with six times the cells in cortex, with six times the cells
everywhere else, and without noise (the rate engine), each that spikes with a decoder of its own
cortical spikes. More cells tell which noise it is, no noise what its dynamics alone take away.
Nothing is chosen by these numbers.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

import pandas as pd

from benchmarks.scores.agreement import SCORING_SEED, Condition, conditions, groups
from benchmarks.scores.pieces import Made, Piece, Score, main, wide
from bgmodel.comparison.circuits import CIRCUIT, MSPRT_AT_GAIN, compare_with_msprt
from bgmodel.integrators.basal_ganglia import BasalGanglia
from circuits.engines import NOISY
from circuits.spec import Circuit

TIMES = 6
"""So many times the cells."""
TRIALS, COARSE_TRIALS = 1000, 100


def cases(table: Circuit) -> Iterator[tuple[str, str, Circuit]]:
    """Yield name, engine and circuit of each case."""
    spiking = [row.name for row in table.populations if row.spiking]
    others = [name for name in spiking if name != table.input]
    yield "as_it_is", "ensemble", table
    yield "more_cells_outside_cortex", "ensemble", with_cells(table, others)
    yield "more_cells_in_cortex", "ensemble", with_cells(table, [table.input])
    yield "no_noise", "rate", table


def with_cells(table: Circuit, names: list[str]) -> Circuit:
    """Return the circuit with ``TIMES`` the cells in some populations."""
    for name in names:
        table = table.with_population(name, neurons=TIMES * table.population(name).neurons)
    return table


def times(condition: Condition, workers: int) -> pd.DataFrame:
    """Return the comparison of each case with the MSPRT at the circuit's gain."""
    evidence, parts = condition.draw(), []
    for case, engine, edited in cases(condition.table):
        noisy = engine in NOISY
        options = {"workers": workers} if noisy else {}
        seed = SCORING_SEED if noisy else None
        model = BasalGanglia(edited, engine, condition.gain, seed, options)
        given = {"rivals": (), "groups": groups(condition)}
        found = compare_with_msprt(model, evidence, seed=SCORING_SEED, **given)
        parts.append(found[found["reference"] == MSPRT_AT_GAIN].assign(case=case))
    return pd.concat(parts, ignore_index=True).assign(evidence=condition.name)


def pieces(fast: bool, workers: int) -> Iterator[Piece]:
    """Yield a piece per evidence of up to four alternatives, readings every 50 ms."""
    trials = COARSE_TRIALS if fast else TRIALS
    for condition in conditions(fast, trials):
        if condition.usual and condition.table.channels <= 4:
            make = partial(times, condition, workers)
            yield Piece("times", condition.name, trials, 8 * condition.seconds, make)


def tables(made: Made) -> dict[str, tuple[str, pd.DataFrame]]:
    """Return the correlation of decision times in each case, and the decoder's."""
    found = made["times"]
    found = found[found["measure"] == "pearson_r"]
    own = found[found["model"] == CIRCUIT]
    decoded = found[(found["model"] != CIRCUIT) & (found["case"] == "as_it_is")]
    both = pd.concat([own.assign(measure=own["case"]), decoded.assign(measure="decoder")])
    return {"times": ("times", wide(both, ["evidence", "accuracy"]))}


SCORE = Score("limits", SCORING_SEED, (2, 4), pieces, tables)

if __name__ == "__main__":
    main(SCORE)
