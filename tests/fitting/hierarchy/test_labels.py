"""The labelled tree, and that ArviZ's libraries read it."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
import xarray

from bgmodel.fit_trials import fit
from bgmodel.fitting.algorithms import GapModel
from bgmodel.fitting.hierarchy.labels import MOST_DRAWS, draw_group, legend, new_trials, pooled
from bgmodel.fitting.person_fit import cells_of
from bgmodel.fitting.responses import moments
from circuits.errors import FitWarning
from tests.drawn import drawn
from tests.fitting.conftest import FIXED, MOST, PEOPLE, short_chains, table
from tests.fitting.test_misfit import truth


@pytest.fixture(scope="module")
def path(group, tmp_path_factory):
    return group.to_netcdf(tmp_path_factory.mktemp("netcdf") / "group.nc")


@pytest.fixture(scope="module")
def tree(path):
    with xarray.open_datatree(path, engine="h5netcdf") as opened:
        return opened.load()


def test_a_file_holds_all_groups(tree, group):
    groups = {"posterior", "sample_stats", "log_likelihood", "posterior_predictive"}
    assert set(tree.children) == groups | {"observed_data", "constant_data"}
    assert tree["posterior/bound"].dims == ("chain", "draw")
    assert tree["posterior_predictive/rt"].sizes == tree["log_likelihood/rt"].sizes
    assert tree["posterior/bound_of"].sel(participant="ben").shape == (4, MOST)
    assert np.array_equal(tree["posterior/bound"], group.group[..., 1])
    assert np.array_equal(tree["sample_stats/lp"], group.log_likelihood.sum(axis=2))


def test_log_likelihood_of_trials_sums_to_that_of_people(tree, group):
    each = tree["log_likelihood/rt"]
    assert each.sizes["draw"] == min(MOST, MOST_DRAWS)
    last = each.isel(draw=-1).groupby("participant_of").sum().sel(participant_of="dora")
    assert last.to_numpy() == pytest.approx(group.log_likelihood[:, -1, 3])


def test_each_trial_has_its_strength_and_conditions():
    with short_chains(), pytest.warns(FitWarning, match="have not converged"):
        fitted = fit(
            table(), "constant_gap", strength="strength", fix=FIXED | {"t0_s": 0.3},
            vary={"bound": "block"}, most_draws=MOST, people="hierarchical")  # fmt: skip
    stored = fitted.to_datatree()["constant_data"].to_dataset()
    assert set(stored["strength"].to_numpy()) == {0.2}
    for who in PEOPLE:
        design = fitted.likelihoods[who].design
        block = stored["block"][(stored["participant_of"] == who).to_numpy()].to_numpy()
        levels = np.array(design.conditions["block"])
        assert np.array_equal(block, levels[design.observed.cell])
        assert set(block) == {"early", "late"}


def test_new_trials_of_each_person_are_those_of_their_densities(group):
    vectors = group.individual[:, :50].copy()
    # Far apart, so that the parameters of another person would be seen.
    vectors[..., group.parameters.index("t0_s")] = 0.2 * (1 + np.arange(len(PEOPLE)))
    rt_s, response = new_trials(group.likelihoods, vectors)
    who = np.repeat(np.arange(len(PEOPLE)), 60)
    for k, likelihood in enumerate(group.likelihoods.values()):
        likelihood = likelihood.complete(np.median(vectors[:, :, k], axis=(0, 1)))
        computed = [
            moments(likelihood.density(vector), likelihood.design.grid)
            for vector in vectors[:, :, k].reshape(-1, vectors.shape[-1])
        ]
        late, right = rt_s[..., who == k], response[..., who == k] == 1
        known = {name: np.mean([each[name] for each in computed]) for name in computed[0]}
        mean_s, sd_s, share = (known[name] for name in ("mean_s", "sd_s", "accuracy"))
        assert abs(late.mean() - mean_s) < 4 * sd_s / np.sqrt(late.size)
        assert abs(right.mean() - share) < 4 * np.sqrt(share * (1 - share) / right.size)


def test_the_file_opens_in_arviz(path, tree):
    arviz = pytest.importorskip("arviz")
    # From version 1 on, ArviZ leaves opening to xarray.
    opened = getattr(arviz, "from_netcdf", xarray.open_datatree)(path)
    assert np.array_equal(opened.posterior["bound"], tree["posterior/bound"])
    assert opened.posterior_predictive["response"].dtype == np.int8
    # Its own PSIS-LOO, of the log likelihoods of trials.
    loo = arviz.loo(opened)
    best = tree["log_likelihood/rt"].sum("trial").max()
    assert best - 100 < getattr(loo, "elpd_loo", getattr(loo, "elpd", None)) < best


def test_conditions_share_their_axis_and_order_and_coefficients_do_not():
    names = ["bound[speed=no]", "bound[speed=yes]", "drift[Intercept]", "drift[speed]"]
    rows = [(who, n, m) for n, ms in zip(names, ([1, 2], [5, 4], [9, 8], [0, 1]), strict=True)
            for who, m in zip("ab", ms, strict=True)]  # fmt: skip
    people = pd.DataFrame(rows, columns=["participant", "parameter", "median"])
    people = people.assign(low=people["median"] - 0.5, high=people["median"] + 0.5)
    group = people.groupby("parameter", sort=False)[["median", "low", "high"]].mean()
    axes = draw_group(people, group, 10).axes
    orders = [[label.get_text() for label in ax.get_yticklabels()] for ax in axes]
    assert orders == [["a", "b"], ["a", "b"], ["b", "a"], ["a", "b"]]
    assert axes[0].get_xlim() == axes[1].get_xlim()
    assert axes[2].get_xlim() != axes[3].get_xlim()
    assert [ax.get_title(loc="left") for ax in axes[:2]] == ["speed=no", "speed=yes"]


def test_a_legend_has_the_units_of_parameters_that_are_there():
    read = "low to high: 90 % of the posterior"
    assert legend(["t0_s"]) == read
    units = legend(["bound[speed=no]", "t0_s", "bound by group"], signed=True)
    assert units == f"{read}; above_zero: a probability; bound (√s)"


def test_there_is_a_panel_for_each_parameter_with_everyone_in_it(group):
    figure = group.plot()
    labels = [ax.get_xlabel() for ax in figure.axes]
    assert len(labels) == len(group.parameters)
    assert all(label.startswith(p) for label, p in zip(labels, group.parameters, strict=True))
    for ax in figure.axes:
        assert {label.get_text() for label in ax.get_yticklabels()} == set(PEOPLE)
    assert "4 people, 240 trials" in figure.get_suptitle()


STRENGTHS, SEED = [0.05, 0.2], 24_393
DEADLINE_S = 0.8
WIDE = (0.0, np.inf)


def person(sensitivity, seed, each=60, strengths=STRENGTHS, seconds=3.0):
    values = {"sensitivity": sensitivity, "bound": 0.7}
    some = drawn(GapModel(), strengths, each, seed, seconds=seconds, **values)
    return truth(some, sensitivity, rt_window=WIDE)


def cells(one):
    return cells_of(one.complete.likelihood.design, one.complete.density)


def test_one_person_pooled_is_that_person():
    one = person(8.0, SEED)
    pd.testing.assert_frame_equal(pooled([one]), cells(one))


def test_missed_deadlines_count_as_trials_and_change_no_other_number():
    one = person(2.0, SEED, each=60)
    seen = one.likelihood.design.observed
    late = seen.rt_s > DEADLINE_S
    rt_s, response = np.where(late, np.nan, seen.rt_s), np.where(late, -1, seen.response)
    missed = replace(seen, deadline_s=DEADLINE_S, rt_s=rt_s, response=response)
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
        within = (one[f"{made}sd_s"] ** 2 + 3 * other[f"{made}sd_s"] ** 2) / 4
        between = 3 / 16 * (one[f"{made}mean_s"] - other[f"{made}mean_s"]) ** 2
        np.testing.assert_allclose(rows[f"{made}sd_s"] ** 2, within + between)
    ends = np.array([one["model_q90_s"], other["model_q90_s"]])
    assert rows["model_q90_s"].between(*np.sort(ends, axis=0)).all()


@pytest.mark.parametrize("strengths", [[0.05, 0.3], [0.05]])
def test_people_with_other_strengths_are_not_pooled(strengths):
    assert pooled([person(8.0, SEED), person(8.0, SEED, strengths=strengths)]) is None
