"""The labelled tree, and that ArviZ's libraries read it."""

import numpy as np
import pytest
import xarray

from bgmodel.fit_trials import fit
from bgmodel.fitting.hierarchy.labels import MOST_DRAWS, new_trials
from bgmodel.fitting.responses import moments
from circuits.errors import FitWarning
from tests.fitting.conftest import FIXED, MOST, PEOPLE, short_chains, table


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
        mean_s, sd_s, share = (
            np.mean([each[n] for each in computed]) for n in ("mean_s", "sd_s", "accuracy")
        )
        assert abs(late.mean() - mean_s) < 4 * sd_s / np.sqrt(late.size)
        assert abs(right.mean() - share) < 4 * np.sqrt(share * (1 - share) / right.size)


def test_the_file_opens_in_arviz(path, tree):
    arviz = pytest.importorskip("arviz")
    # From version 1 on, ArviZ leaves opening to xarray.
    opened = getattr(arviz, "from_netcdf", xarray.open_datatree)(path)
    assert float(opened.posterior["bound"].mean()) == pytest.approx(
        float(tree["posterior/bound"].mean())
    )
    assert opened.posterior_predictive["response"].dtype == np.int8
    # Its own PSIS-LOO, of the log likelihoods of trials.
    loo = arviz.loo(opened)
    best = tree["log_likelihood/rt"].sum("trial").max()
    assert best - 100 < getattr(loo, "elpd_loo", getattr(loo, "elpd", None)) < best
