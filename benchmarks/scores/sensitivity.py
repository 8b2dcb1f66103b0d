"""Every number of the default table up and down, acute and after homeostasis: make score.

The effect of a change with the threshold kept, and the remaining agreement with the MSPRT after the
threshold is retuned to the same accuracy. After homeostasis each population is back at its old
resting rate (``Circuit.compensate``); the rule on the weight from STN onto SNr is that of
``Circuit.balanced``. By populations, on raw evidence; figure A3 is drawn
from the table, and ``worst`` does the worst changes again in spikes.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from typing import NamedTuple

import pandas as pd

from benchmarks.scores.pieces import Made, Piece, Score, main, wide
from bgmodel import stream
from bgmodel.comparison.edited import compare_edits
from bgmodel.evidence import Evidence
from bgmodel.integrators.basal_ganglia import BasalGanglia
from bgmodel.integrators.criterion import gain_of
from bgmodel.simulated_evidence import gaussian_evidence
from circuits.anatomy import DEFAULT, load_circuit
from circuits.circuit import Circuit
from circuits.engines import Population
from circuits.laws.controls import perturbed

SCORING_SEED = 40_004
ACCURACIES = (0.9, 0.95)
TRIALS, COARSE_TRIALS = 5000, 200
READINGS = {2: 80, 4: 40}
D_PRIME = {2: 0.5, 4: 1.0}
SECONDS = 0.001
"""CPU time of a trial of a change, about."""
MEASURES = ("pearson_r", "agreement", "extra_ms")
KEPT = ("expected_accuracy", "mean_ms")
ACUTE, BIASES, BOTH = "acute", "homeostasis", "homeostasis and balance"
SHORT = {ACUTE: "acute", BIASES: "biases", BOTH: "both"}
SHOWN = (0.2, 0.9)
"""The share and the accuracy at which each weight is shown."""
WORST = 10
"""Number of changes repeated in spikes: those that reduce r most after homeostasis."""
STATIC = ("weight", "bias_nats", "gain_hz_per_nat", "baseline_hz")
"""Numbers that act at rest; the others are times and the noise of cells."""


class Case(NamedTuple):
    """Number of alternatives, size of the change, kind of numbers, and recovery.

    ``rules`` are ACUTE; BIASES, after homeostasis; or BOTH, after that and the rule on STN->SNr.
    """

    channels: int
    fraction: float
    static: bool
    rules: str

    @property
    def name(self) -> str:
        """What the case is called."""
        kind = "static" if self.static else "times and cells"
        return f"N = {self.channels}, {self.fraction:.0%}, {kind}, {self.rules}"

    def edited(self) -> dict[str, Circuit]:
        """Return the changed circuits by name, without the share, recovered as the rules say."""
        table = load_circuit(DEFAULT, self.channels)
        return {name: self._after(each, table) for name, each in self.acute().items()}

    def acute(self) -> dict[str, Circuit]:
        """Return the changed circuits by name, before any recovery."""
        found = perturbed(load_circuit(DEFAULT, self.channels), self.fraction).items()
        static = {name: any(f" {field} " in name for field in STATIC) for name, _ in found}
        return {name: each for name, each in found if static[name] == self.static}

    def _after(self, changed: Circuit, table: Circuit) -> Circuit:
        if self.rules == ACUTE:
            return changed
        recovered = changed.compensate(table)
        return recovered if self.rules == BIASES else recovered.balanced().compensate(table)


CASES = (
    *(Case(n, f, True, rules) for n in (2, 4) for f in (0.1, 0.2) for rules in (BIASES, BOTH)),
    *(Case(n, 0.2, static, ACUTE) for n in (2, 4) for static in (True, False)),
)


def evidence(channels: int, trials: int) -> Evidence:
    """Draw the evidence of the cases with a number of alternatives."""
    given = {"d_prime": D_PRIME[channels], "t_max": READINGS[channels]}
    rng = stream(SCORING_SEED, "sensitivity", str(channels))
    return gaussian_evidence(trials, channels=channels, seed=rng, **given)


def changes(case: Case, trials: int, workers: int) -> pd.DataFrame:
    """Return the effect of each change on each measure; NaN where the accuracy is not reached.

    ``expected_accuracy`` and ``mean_ms`` are changes at the threshold that was kept.
    """
    table = load_circuit(DEFAULT, case.channels)
    engine = Population(workers=workers)
    model = BasalGanglia(table, engine, gain_of(table), SCORING_SEED)
    found = compare_edits(
        model,
        case.edited(),
        evidence(case.channels, trials),
        seed=SCORING_SEED,
        accuracies=ACCURACIES,
        resamples=200,
    )
    tuned = found[(found["kind"] == "change") & found["measure"].isin(MEASURES)]
    tuned = wide(tuned[tuned["variant"] != "intact"], ["variant", "accuracy"])
    kept = found[(found["kind"] == "fixed") & found["measure"].isin(KEPT)]
    kept = kept.pivot_table(index=["variant", "accuracy"], columns="measure", values="value")
    kept = kept - kept.loc["intact"].reindex(kept.index, level="accuracy")
    both = tuned.merge(kept.reset_index(), how="left", on=["variant", "accuracy"])
    return both.assign(trials=trials, **case._asdict())


def pieces(fast: bool, workers: int) -> Iterator[Piece]:
    """Yield a piece for each case."""
    trials = COARSE_TRIALS if fast else TRIALS
    for case in CASES:
        make = partial(changes, case, trials, workers)
        seconds = SECONDS * trials * len(case.acute())
        yield Piece("changes", case.name, trials, seconds, make)


def tables(made: Made) -> dict[str, tuple[str, pd.DataFrame]]:
    """Return a summary a case and accuracy, and what changes of weights do to r of times."""
    found, by = made["changes"], ["channels", "fraction", "static", "rules", "accuracy"]
    rows = []
    for key, part in found.groupby(by, sort=False):
        known = part["pearson_r"].notna()
        row = dict(zip(by, key, strict=True)) | {"changes": len(part), "reached": known.sum()}
        row |= {f"{name}_median": part[name].median() for name in MEASURES}
        worst = part.loc[part["pearson_r"].idxmin()] if known.any() else part.iloc[0]
        row |= {"worst": worst["variant"], "worst_r": worst["pearson_r"]}
        row |= {"worst_low": worst["pearson_r_low"], "worst_high": worst["pearson_r_high"]}
        row |= {"most_accuracy": part["expected_accuracy"].abs().max()}
        row |= {"most_ms": part["mean_ms"].abs().max()}
        row["not_reached"] = "; ".join(part.loc[~known, "variant"])
        rows.append(row)
    shown = found["variant"].str.contains(" weight ") & (found["fraction"] == SHOWN[0])
    weights = found[shown & (found["accuracy"] == SHOWN[1])]
    of_r = [f"pearson_r{end}" for end in ("", "_low", "_high")]
    weights = weights.pivot(index="variant", columns=["channels", "rules"], values=of_r).round(4)
    weights.columns = [
        f"{SHORT[rules]}_{channels}{name.removeprefix('pearson_r')}"
        for name, channels, rules in weights.columns
    ]
    recovered = found[found["static"] & (found["rules"] == BIASES)]
    worst = recovered[recovered["accuracy"] == SHOWN[1]].nsmallest(WORST, "pearson_r")
    kept = ["channels", "fraction", "variant", "accuracy", "trials"]
    kept += [f"{name}{end}" for name in MEASURES for end in ("", "_low", "_high")]
    return {
        "summary": ("changes", pd.DataFrame(rows)),
        "weights": ("changes", weights.reset_index()),
        "worst": ("changes", worst[kept]),
    }


SCORE = Score("sensitivity", SCORING_SEED, (2, 4), pieces, tables, circuit=DEFAULT)

if __name__ == "__main__":
    main(SCORE)
