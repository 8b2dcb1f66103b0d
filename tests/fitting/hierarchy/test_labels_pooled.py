"""Pooled cells hold everyone's trials and the mixture of everyone's predictions."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from bgmodel.fitting.algorithms import GapModel
from bgmodel.fitting.design import design_of
from bgmodel.fitting.hierarchy.labels import pooled
from bgmodel.fitting.likelihood import likelihood_of
from bgmodel.fitting.optimum import Optimum
from bgmodel.fitting.person_fit import cells_of
from tests.drawn import drawn

STRENGTHS, SEED = [0.05, 0.2], 24_393
DEADLINE_S = 0.8
WIDE = (0.0, np.inf)


def person(sensitivity, seed, each=60, strengths=STRENGTHS, seconds=3.0):
    """Return a person's trials with the parameters that made them."""
    truth = {"sensitivity": sensitivity, "bound": 0.6}
    some = drawn(GapModel(), strengths, each, seed, seconds=seconds, **truth)
    likelihood = likelihood_of(GapModel(), design_of(some, rt_window=WIDE))
    values = {**dict(zip(likelihood.freedom.names, likelihood.freedom.start, strict=True)), **truth}
    at = np.array([values[name] for name in likelihood.freedom.names])
    return Optimum(likelihood, at, 0.0, 0)


def cells(one):
    return cells_of(one.complete.likelihood.design, one.complete.density)


def test_one_person_pooled_is_that_person():
    one = person(8.0, SEED)
    pd.testing.assert_frame_equal(pooled([one]), cells(one))


def test_missed_deadlines_count_as_trials_and_change_no_other_number():
    one = person(2.0, SEED, each=60)
    seen = one.likelihood.design.observed
    late = seen.rt_s > DEADLINE_S
    missed = replace(
        seen, deadline_s=DEADLINE_S, rt_s=np.where(late, np.nan, seen.rt_s),
        response=np.where(late, -1, seen.response),
    )  # fmt: skip
    design = replace(one.likelihood.design, observed=missed)
    one = replace(one, likelihood=replace(one.likelihood, design=design))
    assert 5 < late.sum() < 100
    pd.testing.assert_frame_equal(pooled([one]), cells(one))


def test_everyones_trials_are_there_and_models_have_their_share_of_them():
    people = [person(4.0, SEED, each=40), person(16.0, SEED + 1, each=120, seconds=2.0)]
    rows, (one, other) = pooled(people), map(cells, people)
    assert rows["trials"].tolist() == [160, 160]
    for name in ("accuracy", "mean_s", "model_accuracy", "model_mean_s"):
        assert rows[name].to_numpy() == pytest.approx((one[name] + 3 * other[name]).to_numpy() / 4)
    # Of the variances of a mixture: that within people and that between them.
    for made in ("", "model_"):
        within = one[f"{made}sd_s"] ** 2 / 4 + 3 * other[f"{made}sd_s"] ** 2 / 4
        between = 3 / 16 * (one[f"{made}mean_s"] - other[f"{made}mean_s"]) ** 2
        variance = rows[f"{made}sd_s"].to_numpy() ** 2
        assert variance == pytest.approx((within + between).to_numpy())
    ends = np.array([one["model_q90_s"], other["model_q90_s"]])
    assert rows["model_q90_s"].between(*np.sort(ends, axis=0)).all()


@pytest.mark.parametrize("strengths", [[0.05, 0.3], [0.05]])
def test_people_with_other_strengths_are_not_pooled(strengths):
    assert pooled([person(8.0, SEED), person(8.0, SEED, strengths=strengths)]) is None
