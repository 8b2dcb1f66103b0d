"""People who learn values: models of their choices and times, compared on left-out trials.

The 28 people of the probabilistic selection set learn three pairs of items, AB, CD and EF, from
rewards. The following was written down before the data were looked at; known beforehand were the
accuracy and median times of each pair, and the sums of BIC of fits without left-out trials.

Expected, with the size that would count:

1. Q with two rates predicts left-out trials better than with one: by 4 to 12 nats per person. The
   known BIC differ by 290 nats in all, for one rate without stickiness.
2. Stickiness is towards the last choice: mean start between 0.02 and 0.15 of the bound.
3. The baseline model without learning predicts left-out trials worse than Q with two rates, by 2
   to 10 nats per person, because curves rise within the session.
4. From the first 10 to the last 10 trials of a pair the share of the better item rises by 0.10 to
   0.30 in AB, and by 0 to 0.10 in EF.
5. Median times fall with the fitted difference of values: the fourth of trials with the largest
   difference is 30 to 200 ms faster than that with the smallest.
6. Errors take longer than correct responses of the same pair, by 0 to 100 ms in the median; a
   diffusion whose drift rises with learning gives a small difference of the same sign.
7. In Q with two rates gains are learned faster than losses in most people: the median of the
   log-ratio is positive. This is no claim about dopamine: see below.
8. The confidence rule with two rates predicts left-out trials as well as Q with two rates, to
   within 2 nats per person.

Asymmetry of rates and stickiness are confounded: who repeats choices whatever follows learns, in
effect, more from gains than from losses. Expected in simulated people with one rate and a start of
0.1 of the bound towards the last choice: fitted without stickiness, the mean log-ratio of the rates
is above zero; fitted with it, its interval contains zero.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache, partial
from typing import Any

import numpy as np
import pandas as pd

from bgmodel.fitting.model_comparison import predicted
from bgmodel.fitting.optimum import Optimum, optimum
from bgmodel.learning.value_models import MODELS, likelihood, simulated
from bgmodel.trials.reader import read_trials
from bgmodel.trials.record import Trials
from figures.learning.value_people import (
    by_difference,
    courses,
    like,
    log_ratio,
    mean_and_error,
    quarters,
    recovered,
    rises,
    slow_errors,
)
from figures.pieces import Made, Piece, Score

SCORING_SEED = 45_003
"""Seed of simulated people, their parameters, and posterior draws."""
REFERENCE = "q"
"""The model with which others are compared."""
DRAWN = "confidence, two rates"
"""The model whose predictions are compared with people's choices and times."""
RECOVERED = ("q", "q, two rates", "confidence, two rates")
"""Models whose parameters are sought in simulated people."""
CONFOUNDED = {"rate": 0.15, "scale": 2.0, "bound": 0.9, "t0_s": 0.4, "stickiness": 0.1}
"""Simulated people with one rate who repeat choices."""


@cache
def people_of(people: int) -> dict[str, Trials]:
    """Return the first people of the built-in set."""
    return dict(list(read_trials("pedersen_frank_2020").by_participant().items())[:people])


@cache
def fits_of(model: str, people: int) -> dict[str, Optimum]:
    """Return the fits of a model to all trials of each person."""
    return {who: optimum(likelihood(model, one)) for who, one in people_of(people).items()}


def fitted(model: str, people: int) -> pd.DataFrame:
    """Return one row per person: estimates, and log-likelihoods of fitted and left-out trials."""
    rows = []
    for who, fit in fits_of(model, people).items():
        out = float(predicted(fit.likelihood, start=fit.vector).each.sum())
        trials = len(fit.likelihood.design.observed.response)
        bic = len(fit.vector) * np.log(trials) - 2 * fit.log_likelihood
        parts = [part["median_s"] for part in quarters(fit, SCORING_SEED, who)]
        rows.append(
            {"participant_id": who, "model": model, "fitted": len(fit.vector),
             "log_likelihood": fit.log_likelihood, "bic": bic, "left_out": out,
             "faster_ms": 1e3 * (parts[0] - parts[-1]), **fit.values}
        )  # fmt: skip
    return pd.DataFrame(rows)


def compared(rows: pd.DataFrame) -> pd.DataFrame:
    """Return one row per model: sums, and left-out trials compared with the reference."""
    base = rows[rows["model"] == REFERENCE].set_index("participant_id")["left_out"]
    summaries = []
    for model, of_model in rows.groupby("model", sort=False):
        better = of_model.set_index("participant_id")["left_out"] - base
        mean, error = mean_and_error(better) if model != REFERENCE else (0.0, 0.0)
        summaries.append(
            {"model": model, "fitted": int(of_model["fitted"].iloc[0]),
             "log_likelihood": of_model["log_likelihood"].sum(), "bic": of_model["bic"].sum(),
             "left_out": of_model["left_out"].sum(), "better_nats": mean, "error_nats": error,
             "better_people": int((better > 0).sum()), "people": len(of_model)}
        )  # fmt: skip
    return pd.DataFrame(summaries)


def expected(rows: pd.DataFrame) -> pd.DataFrame:
    """Return the ranges expected before the data were analysed, with the values obtained."""
    out = rows.pivot(index="participant_id", columns="model", values="left_out")
    people = len(out)
    known = people_of(people)
    two, both = out["q, two rates"], rows[rows["model"] == "q, two rates"]
    faster = rows.loc[rows["model"] == DRAWN, "faster_ms"]
    expectations = [
        ("two rates less one, nats", 4, 12, *mean_and_error(two - out["q"])),
        ("stickiness, share of the bound", 0.02, 0.15, *mean_and_error(both["stickiness"])),
        ("two rates less no learning, nats", 2, 10, *mean_and_error(two - out["no learning"])),
        ("rise of choices, AB", 0.10, 0.30, *mean_and_error(rises(known, "AB"))),
        ("rise of choices, EF", 0.0, 0.10, *mean_and_error(rises(known, "EF"))),
        ("smallest less largest difference, ms", 30, 200, *mean_and_error(faster)),
        ("errors less correct, ms", 0, 100, *mean_and_error(1e3 * np.array(slow_errors(known)))),
        ("share of people who learn more from gains", 0.5, 1.0,
         *mean_and_error((both["rate"] > both["rate_minus"]) * 1.0)),
        ("confidence less Q, both two rates, nats", -2, 2,
         *mean_and_error(out["confidence, two rates"] - two)),
    ]  # fmt: skip
    table = pd.DataFrame(
        expectations, columns=["measure", "expected_low", "expected_high", "value", "se"]
    )
    agrees = (table["value"] >= table["expected_low"]) & (table["value"] <= table["expected_high"])
    return table.assign(agrees=agrees, people=people)


def recovery(model: str, people: int) -> pd.DataFrame:
    """Return how well parameters of simulated people are found, one row per parameter and all."""
    known = MODELS[model]
    true = like(list(fits_of(model, 28).values()), people, SCORING_SEED)
    estimated, inside = recovered(known, true, SCORING_SEED)
    rows: list[dict[str, Any]] = []
    for k, name in enumerate(each.name for each in known.parameters):
        off = estimated[:, k] - true[:, k]
        bias, error = mean_and_error(off)
        share, share_se = mean_and_error(inside[:, k] * 1.0)
        rows.append(
            {"parameter": name, "r": np.corrcoef(estimated[:, k], true[:, k])[0, 1], "bias": bias,
             "bias_se": error, "sd": off.std(ddof=1), "coverage": share, "coverage_se": share_se}
        )  # fmt: skip
    share, share_se = mean_and_error(inside.mean(axis=1))
    rows.append({"parameter": "all", "coverage": share, "coverage_se": share_se})
    return pd.DataFrame(rows).assign(model=model, people=people)


def confounded(people: int) -> pd.DataFrame:
    """Return the asymmetry found in people with one rate who repeat choices."""
    one, ratios = MODELS["q"], []
    for stickiness in (0.0, CONFOUNDED["stickiness"]):
        true = CONFOUNDED | {"stickiness": stickiness}
        values = {name: np.full(people, value) for name, value in true.items()}
        made = simulated(one, values, seed=SCORING_SEED).by_participant().values()
        for fixed in ({"stickiness": 0.0}, {}):
            each = [log_ratio(optimum(likelihood("q, two rates", person, fixed=fixed)).values)
                    for person in made]  # fmt: skip
            mean, error = mean_and_error(each)
            ratios.append(
                {"true_stickiness": stickiness, "with_stickiness": not fixed, "log_ratio": mean,
                 "log_ratio_se": error, "people": people}
            )  # fmt: skip
    return pd.DataFrame(ratios)


def pieces(fast: bool, workers: int) -> Iterator[Piece]:
    """Yield fits to people, their predictions, and simulated people."""
    people, some = (4, 4) if fast else (28, 100)
    trials = sum(person.trials for person in people_of(people).values())
    for model in MODELS:
        yield Piece("people", model, trials, 1.1 * people, partial(fitted, model, people))
    for kind, make in (("courses", courses), ("differences", by_difference)):
        yield Piece(kind, DRAWN, trials, 20, partial(_drawn, make, people))
    yield Piece("confound", "asymmetry", 90 * some, 0.6 * some, partial(confounded, some // 2))
    for model in RECOVERED:
        make = partial(recovery, model, some)
        yield Piece("recovery", model, 180 * some, 0.5 * some, make)


def _drawn(make: Any, people: int) -> pd.DataFrame:
    return make(fits_of(DRAWN, people), SCORING_SEED).assign(model=DRAWN)


def tables(made: Made) -> dict[str, tuple[str, pd.DataFrame]]:
    """Return the tables of pages."""
    kinds = ("courses", "differences", "recovery", "confound")
    every = {kind: (kind, made[kind]) for kind in kinds}
    every["models"] = ("people", compared(made["people"]))
    every["expected"] = ("people", expected(made["people"]))
    return every


SCORE = Score("values", SCORING_SEED, (), pieces, tables, circuit="")
