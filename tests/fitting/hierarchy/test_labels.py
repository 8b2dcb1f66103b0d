"""The labelled tree, and that ArviZ's libraries read it."""

import numpy as np
import pytest
import xarray

from bgmodel.fitting.hierarchy.labels import MOST_DRAWS
from bgmodel.fitting.hierarchy.people import fit_people
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
    assert tree["posterior/bound_of"].sel(participant="ben").shape == (4, MOST)
    assert np.array_equal(tree["posterior/bound"], group.group[..., 1])
    assert np.array_equal(tree["sample_stats/lp"], group.log_likelihood.sum(axis=2))


def test_log_likelihood_of_trials_sums_to_that_of_people(tree, group):
    each = tree["log_likelihood/rt"]
    assert each.sizes["draw"] == min(MOST, MOST_DRAWS)
    last = each.isel(draw=-1).groupby("participant_of").sum().sel(participant_of="dora")
    assert last.to_numpy() == pytest.approx(group.log_likelihood[:, -1, 3])


def test_data_are_those_of_every_trial(tree):
    seen = tree["observed_data"]
    assert seen["rt"].size == 60 * len(PEOPLE)
    assert seen["participant_of"].to_numpy()[0] == "anna"
    assert set(np.unique(seen["response"])) == {0, 1}


def test_each_trial_has_its_strength_and_conditions():
    with short_chains(), pytest.warns(FitWarning, match="have not converged"):
        fit = fit_people(
            table(), "constant_gap", strength="strength", fix=FIXED | {"t0_s": 0.3},
            vary={"bound": "block"}, most_draws=MOST,
        )  # fmt: skip
    given = fit.to_datatree()["constant_data"].to_dataset()
    assert set(given["strength"].to_numpy()) == {0.2}
    for who in PEOPLE:
        design = fit.likelihoods[who].design
        block = given["block"][(given["participant_of"] == who).to_numpy()].to_numpy()
        levels = np.array(design.conditions["block"])
        assert np.array_equal(block, levels[design.observed.cell])
        assert set(block) == {"early", "late"}


def test_libraries_of_arviz_summarise_the_file(tree):
    from arviz_stats.base import array_stats

    ess = array_stats.ess(tree["posterior/bound"].to_numpy(), chain_axis=0, draw_axis=1)
    assert 1 < ess < 4 * MOST * 1.5


def test_new_trials_are_those_of_the_densities(tree, group):
    new, who = tree["posterior_predictive"], list(PEOPLE).index("ben")
    mine = (new["participant_of"] == "ben").to_numpy()
    cell = group.likelihoods["ben"].design.observed.cell
    given = group.individual[:, new["draw"].to_numpy(), who].reshape(-1, len(group.parameters))
    mass = [
        group.likelihoods["ben"].design.observed.outcomes(group.likelihoods["ben"].density(each))[0]
        for each in given
    ]
    share = np.mean([each[cell, 1].sum(axis=1).mean() for each in mass])
    found = new["response"].to_numpy()[..., mine] == 1
    assert abs(found.mean() - share) < 4 * np.sqrt(share * (1 - share) / found.size)


def test_the_file_opens_in_arviz(path, tree):
    arviz = pytest.importorskip("arviz")
    # From version 1 on, ArviZ leaves opening to xarray.
    opened = getattr(arviz, "from_netcdf", xarray.open_datatree)(path)
    assert float(opened.posterior["bound"].mean()) == pytest.approx(
        float(tree["posterior/bound"].mean())
    )
    assert opened.posterior_predictive["response"].dtype == np.int8
    # Its own PSIS-LOO, of the log likelihoods of trials.
    found = arviz.loo(opened)
    best = tree["log_likelihood/rt"].sum("trial").max()
    assert best - 100 < getattr(found, "elpd_loo", getattr(found, "elpd", None)) < best
