"""Recovery of groups of people by hierarchical fits: bias, coverage, ranks and convergence.

Each data set is a piece, stored before the next begins, so that a run continues where it was
stopped. Tables are written from those that are there, and state their number. All of them take
15 hours of CPU; ``BENCHMARKS_OUT`` in the environment names a folder that keeps them, and
``--only`` chooses::

    BENCHMARKS_OUT=folder python -m benchmarks.scores.group_recovery --only "test 00"

``--only none`` writes the tables from the data sets that are there. ``make score`` leaves this
one out.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

import numpy as np
import pandas as pd
from scipy.stats import kstest

from benchmarks.methods.group_recovery import EACH, PEOPLE, STRENGTHS, recovered
from benchmarks.scores.pieces import Made, Piece, Score, main
from bgmodel.fitting.hierarchy.chains import FEWEST_EFFECTIVE, LARGEST_RHAT
from circuits.anatomy import DEFAULT

SCORING_SEED = 47_801
"""Of groups, their trials and the chains of their fits."""
SETS, COARSE_SETS = {"test": 100, "circuit": 30}, 1
SECONDS = {"test": 240, "circuit": 900}
TURN = 4
"""Data sets by the test between two by the circuit."""
NUMBERS = ["mean", "spread"]
"""Numbers of the group."""


def order(tests: int, circuits: int) -> Iterator[tuple[str, int]]:
    """Yield the data sets: four by the test, then one by the circuit, until none is left."""
    every = [(float(number), "test", number) for number in range(tests)]
    every += [(TURN * (number + 1) - 0.5, "circuit", number) for number in range(circuits)]
    yield from ((by, number) for _, by, number in sorted(every))


def pieces(fast: bool, workers: int) -> Iterator[Piece]:
    """Go through the data sets."""
    sets = dict.fromkeys(SETS, COARSE_SETS) if fast else SETS
    for by, number in order(sets["test"], sets["circuit"]):
        make = partial(recovered, by, SCORING_SEED, number, workers=workers)
        size = PEOPLE * EACH * len(STRENGTHS)
        yield Piece("sets", f"{by} {number:03d}", size, SECONDS[by], make)


def tables(made: Made) -> dict[str, tuple[str, pd.DataFrame]]:
    """Return recovery by number of the group, that of all of them, and each data set."""
    found = made["sets"].sort_values(["by", "set"], kind="stable", ascending=[False, True])
    group = found[found["of"].isin(NUMBERS)]
    return {
        "numbers": ("sets", numbers(found)),
        "pooled": ("sets", pooled(found)),
        "groups": ("sets", group.drop(columns="person")),
    }


def covered(found: pd.DataFrame) -> pd.DataFrame:
    """Return the rows with whether intervals contain the truth.

    ``held`` for those of the fit, ``held_prior`` for those under the prior that made the data.
    """
    held = (found["low"] <= found["truth"]) & (found["truth"] <= found["high"])
    return found.assign(held=held, held_prior=found["rank"].between(0.05, 0.95))


def numbers(found: pd.DataFrame) -> pd.DataFrame:
    """Return a row per number of the group, and one per parameter of its people.

    Ranks of people are those of the first person of each data set, which are independent.
    """
    rows = []
    for (by, of, name), some in covered(found).groupby(["by", "of", "parameter"], sort=False):
        middle = float(np.mean(some["truth"]))
        by_set, prior = (
            (some[each] - some["truth"]).groupby(some["set"]).mean() / middle
            for each in ("mean", "mean_prior")
        )
        first = pd.to_numeric(some["person"], errors="coerce").fillna(0) == 0
        ranks = some.loc[first, "rank"].dropna()
        rows.append(
            {
                "by": by, "of": of, "parameter": name, "sets": some["set"].nunique(),
                "bias": by_set.mean(), "error": by_set.sem(),
                "bias_prior": prior.mean(), "error_prior": prior.sem(),
                "coverage": some["held"].mean(), "coverage_prior": some["held_prior"].mean(),
                "uniform_p": kstest(ranks, "uniform").pvalue if len(ranks) else np.nan,
                "rank": ranks.mean(), "correlation": some["truth"].corr(some["mean"]),
            }
        )  # fmt: skip
    return pd.DataFrame(rows)


def pooled(found: pd.DataFrame) -> pd.DataFrame:
    """Return coverage, ranks and convergence over all numbers of the groups, and of their people.

    ``uniform_p`` is the smallest over numbers, times their number (Bonferroni).
    """
    rows = []
    each = numbers(found)
    every = covered(found).assign(of=found["of"].where(found["of"] == "person", "group"))
    each = each.assign(of=each["of"].where(each["of"] == "person", "group"))
    for (by, of), some in every.groupby(["by", "of"], sort=False):
        by_set = some.groupby("set")
        share, prior = by_set["held"].mean(), by_set["held_prior"].mean()
        own = each[(each["by"] == by) & (each["of"] == of)]
        good = (some["rhat"] < LARGEST_RHAT) & (some["effective"] >= FEWEST_EFFECTIVE)
        rows.append(
            {
                "by": by, "of": of, "sets": len(share), "numbers": len(some),
                "coverage": share.mean(), "error": share.sem(),
                "lowest_coverage": own["coverage"].min(),
                "coverage_prior": prior.mean(), "error_prior": prior.sem(),
                "uniform_p": min(1.0, own["uniform_p"].min() * len(own)),
                "converged": good.mean(), "converged_sets": good.groupby(some["set"]).all().mean(),
                "largest_rhat": some["rhat"].max(), "fewest_effective": some["effective"].min(),
            }
        )  # fmt: skip
    return pd.DataFrame(rows)


SCORE = Score("recovery_groups", SCORING_SEED, (2,), pieces, tables, circuit=DEFAULT, partial=True)

if __name__ == "__main__":
    main(SCORE)
