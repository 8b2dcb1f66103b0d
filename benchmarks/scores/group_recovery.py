"""Recovery of groups of people by hierarchical fits: bias, coverage, ranks and convergence.

Each data set is a piece, stored before the next begins, so that a run continues where it was
stopped. Data sets of an earlier run, also on another machine, are taken from the stored table of
data sets, which must be deleted after a change of the sampler. Summaries use consecutive data sets
only: those that finish first have chains that mix well. All of them take four hours of CPU;
``--only`` chooses::

    python -m benchmarks.scores.group_recovery --only "test 00"

``make score`` leaves this one out.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

import numpy as np
import pandas as pd
from scipy.stats import kstest

from benchmarks.methods.group_recovery import EACH, PEOPLE, STRENGTHS, recovered
from benchmarks.pages import TABLES
from benchmarks.scores.pieces import Made, Piece, Score, main
from bgmodel.fitting.hierarchy.chains import FEWEST_EFFECTIVE, LARGEST_RHAT
from bgmodel.support.files import is_result, read_provenance, read_table
from circuits.anatomy import DEFAULT

SCORING_SEED = 47_801
"""Of groups, their trials and the chains of their fits."""
SETS, COARSE_SETS = {"test": 100, "circuit": 30}, 1
SECONDS = {"test": 60, "circuit": 240}
TURN = 4
"""Data sets by the test between two by the circuit."""
SIZE = PEOPLE * EACH * len(STRENGTHS)
"""Trials of a data set."""


def order(tests: int, circuits: int) -> Iterator[tuple[str, int]]:
    """Yield the data sets: four by the test, then one by the circuit, until none is left."""
    every = [(float(number), "test", number) for number in range(tests)]
    every += [(TURN * (number + 1) - 0.5, "circuit", number) for number in range(circuits)]
    yield from ((by, number) for _, by, number in sorted(every))


def pieces(fast: bool, workers: int) -> Iterator[Piece]:
    """Go through the data sets, without those of an earlier run."""
    sets = dict.fromkeys(SETS, COARSE_SETS) if fast else SETS
    done = set() if fast else set(zip(*(stored()[name] for name in ("by", "set")), strict=True))
    for by, number in order(sets["test"], sets["circuit"]):
        if (by, number) not in done:
            make = partial(recovered, by, SCORING_SEED, number, workers=workers)
            yield Piece("sets", f"{by} {number:03d}", SIZE, SECONDS[by], make)


def stored() -> pd.DataFrame:
    """Return the data sets of the stored table, if it is of this seed and these circuits."""
    path = TABLES / f"{SCORE.name}_groups.csv"
    if path.is_file() and is_result(path):
        found = read_provenance(path)
        if (found["parameters"], found["seed"]) == (SCORE.behind([SIZE], False), SCORING_SEED):
            return read_table(path)
    return pd.DataFrame({"by": [], "set": []})


def tables(made: Made) -> dict[str, tuple[str, pd.DataFrame]]:
    """Return recovery by number of the group, that of all of them, and each data set."""
    new, old = condensed(made["sets"]), stored()
    key = ["by", "set"]
    # The coarse form computes data sets again, and stands alone.
    apart = new.merge(old[key], on=key).empty
    found = pd.concat([old, new])[list(new)] if apart else new
    found = found.sort_values(["by", "set"], kind="stable", ascending=[False, True])
    first = without_gap(found)
    summaries = {} if first.empty else {"numbers": numbers(first), "pooled": pooled(first)}
    return {name: ("sets", table) for name, table in {**summaries, "groups": found}.items()}


def without_gap(found: pd.DataFrame) -> pd.DataFrame:
    """Return the rows of the data sets before the first that is missing."""
    kept = []
    for _, some in found.groupby("by", sort=False):
        there = set(some["set"])
        missing = next(number for number in range(len(there) + 1) if number not in there)
        kept.append(some[some["set"] < missing])
    return pd.concat(kept)


def condensed(found: pd.DataFrame) -> pd.DataFrame:
    """Return the rows of the groups' numbers, and one row per parameter of a data set's people.

    Of people: means over them; the rank is that of the first, so that ranks are independent;
    R-hat and effective sample size are the worst. ``held`` and ``held_prior`` are the proportions
    of intervals, of the fit and under the prior that made the data, that contain the truth.
    """
    found = found.assign(
        held=((found["low"] <= found["truth"]) & (found["truth"] <= found["high"])).astype(float),
        held_prior=found["rank"].between(0.05, 0.95).astype(float),
        converged=(
            (found["rhat"] < LARGEST_RHAT) & (found["effective"] >= FEWEST_EFFECTIVE)
        ).astype(float),
        people=1,
    )
    group, people = (part for _, part in found.groupby(found["of"] == "person"))
    rows = []
    means = ["truth", "mean", "mean_prior", "held", "held_prior", "converged", "inside", "draws"]
    for (by, number, name), some in people.groupby(["by", "set", "parameter"], sort=False):
        rows.append(
            {
                "of": "person", "parameter": name, "by": by, "set": number, "people": len(some),
                **{each: some[each].mean() for each in means},
                "rank": some["rank"].iloc[0], "rhat": some["rhat"].max(),
                "effective": some["effective"].min(),
                "correlation": some["truth"].corr(some["mean"]),
            }
        )  # fmt: skip
    return pd.concat([group.drop(columns="person"), pd.DataFrame(rows)], ignore_index=True)


def numbers(found: pd.DataFrame) -> pd.DataFrame:
    """Return a row per number of the group, and one per parameter of its people.

    Takes rows as from ``condensed``.
    """
    rows = []
    for (by, of, name), some in found.groupby(["by", "of", "parameter"], sort=False):
        middle = float(np.mean(some["truth"]))
        by_set, prior = ((some[each] - some["truth"]) / middle for each in ("mean", "mean_prior"))
        ranks = some["rank"].dropna()
        within = some["truth"].corr(some["mean"]) if of != "person" else some["correlation"].mean()
        rows.append(
            {
                "by": by, "of": of, "parameter": name, "sets": some["set"].nunique(),
                "bias": by_set.mean(), "error": by_set.sem(),
                "bias_prior": prior.mean(), "error_prior": prior.sem(),
                "coverage": some["held"].mean(), "coverage_prior": some["held_prior"].mean(),
                "uniform_p": kstest(ranks, "uniform").pvalue if len(ranks) else np.nan,
                "rank": ranks.mean(), "correlation": within,
            }
        )  # fmt: skip
    return pd.DataFrame(rows)


def pooled(found: pd.DataFrame) -> pd.DataFrame:
    """Return coverage, ranks and convergence over all numbers of the groups, and of their people.

    Takes rows as from ``condensed``. ``uniform_p`` is the smallest over numbers, times their number
    (Bonferroni).
    """
    rows = []
    each = numbers(found)
    every = found.assign(of=found["of"].where(found["of"] == "person", "group"))
    each = each.assign(of=each["of"].where(each["of"] == "person", "group"))
    for (by, of), some in every.groupby(["by", "of"], sort=False):
        by_set = some.groupby("set")
        share, prior = by_set["held"].mean(), by_set["held_prior"].mean()
        own = each[(each["by"] == by) & (each["of"] == of)]
        rows.append(
            {
                "by": by, "of": of, "sets": len(share), "numbers": some["people"].sum(),
                "coverage": share.mean(), "error": share.sem(),
                "lowest_coverage": own["coverage"].min(),
                "coverage_prior": prior.mean(), "error_prior": prior.sem(),
                "uniform_p": min(1.0, own["uniform_p"].min() * len(own)),
                "converged": some["converged"].mean(),
                "converged_sets": by_set["converged"].min().eq(1).mean(),
                "largest_rhat": some["rhat"].max(), "fewest_effective": some["effective"].min(),
            }
        )  # fmt: skip
    return pd.DataFrame(rows)


SCORE = Score("recovery_groups", SCORING_SEED, (2,), pieces, tables, circuit=DEFAULT, partial=True)

if __name__ == "__main__":
    main(SCORE)
