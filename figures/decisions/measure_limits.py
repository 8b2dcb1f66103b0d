"""Why the default circuit's decision times differ from those of the MSPRT: make score.

Decisions of populations, unedited, with six times the cells in cortex, and with six times the cells
everywhere else; then of the circuit without noise, unedited and with all delays and time constants
halved. By the attenuation of a correlation (Spearman 1904), r of times is that without noise, times
the square root of r between two runs of the circuit with different noise. These numbers were not
used to choose parameters.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import partial

import pandas as pd

from bgmodel.comparison.compare import compare
from bgmodel.comparison.matched import OTHER_NOISE
from bgmodel.comparison.thresholds import MSPRT_AT_GAIN
from bgmodel.integrators.at_thresholds import CIRCUIT
from bgmodel.integrators.basal_ganglia import BasalGanglia
from bgmodel.integrators.criterion import gain_of
from circuits.anatomy import DEFAULT, load_circuit
from circuits.circuit import Circuit
from circuits.engines import engine_of
from figures.decisions.kinds import SCORING_SEED, Kind, drawn, groups_of, kinds
from figures.pieces import Made, Piece, Score, wide

TIMES = 6
"""Factor on the number of cells."""
TRIALS, COARSE_TRIALS = 5000, 500
AS_IT_IS = "as_it_is"


def cases(table: Circuit) -> Iterator[tuple[str, str, Circuit]]:
    """Yield name, engine and circuit of each case."""
    spiking = table.spiking()
    others = [name for name in spiking if name != table.input]
    yield AS_IT_IS, "population", table
    yield "more_cells_outside_cortex", "population", with_cells(table, others)
    yield "more_cells_in_cortex", "population", with_cells(table, [table.input])
    yield "no_noise", "rate", table
    yield "half_times", "rate", with_times(table, 0.5)


def with_cells(table: Circuit, names: list[str]) -> Circuit:
    """Return the circuit with ``TIMES`` the cells in some populations."""
    for name in names:
        table = table.with_population(name, neurons=TIMES * table.population(name).neurons)
    return table


def with_times(table: Circuit, factor: float) -> Circuit:
    """Return the circuit with all delays and time constants times a factor."""
    for p in table.projections:
        times = {"delay_ms": factor * p.delay_ms, "tau_ms": factor * p.tau_ms}
        table = table.with_projection(p.name, **times)
    for row in table.populations:
        if row.tau_ms:
            table = table.with_population(row.name, tau_ms=factor * row.tau_ms)
    return replace(table, readout_tau_ms=factor * table.readout_tau_ms)


def times(kind: Kind, trials: int, workers: int) -> pd.DataFrame:
    """Return the comparison of each case with the MSPRT at the circuit's gain."""
    table, parts = load_circuit(DEFAULT, kind.channels), []
    for case, engine, edited in cases(table):
        chosen = engine_of(engine).tuned(workers=workers)
        model = BasalGanglia(edited, chosen, gain_of(table), SCORING_SEED)
        comparison = compare(
            model,
            drawn(kind, trials, 50.0),
            seed=SCORING_SEED,
            baselines=(),
            groups=groups_of(kind.name, trials),
            noise_ceiling=case == AS_IT_IS,
        ).table
        parts.append(comparison.assign(case=case))
    return pd.concat(parts, ignore_index=True).assign(evidence=kind.name)


def pieces(fast: bool, workers: int) -> Iterator[Piece]:
    """Yield a piece per evidence of up to four alternatives."""
    trials = COARSE_TRIALS if fast else TRIALS
    for kind in kinds():
        if kind.channels <= 4:
            make = partial(times, kind, trials, workers)
            yield Piece("times", kind.name, trials, trials / 50 * (1 + kind.seconds / 3), make)


def tables(made: Made) -> dict[str, tuple[str, pd.DataFrame]]:
    """Return r of times in each case, that of the circuit with itself, and the attenuated r."""
    rows = made["times"]
    rows = rows[(rows["measure"] == "pearson_r") & (rows["model"] == CIRCUIT)]
    against_test = rows[rows["reference"] == MSPRT_AT_GAIN]
    self = rows[rows["reference"] == OTHER_NOISE]
    both = pd.concat(
        [against_test.assign(measure=against_test["case"]), self.assign(measure="ceiling")]
    )
    times = wide(both, ["evidence", "accuracy"])
    times["attenuated"] = times["no_noise"] * times["ceiling"] ** 0.5
    return {"times": ("times", times)}


SCORE = Score("limits", SCORING_SEED, (2, 4), pieces, tables, circuit=DEFAULT)
