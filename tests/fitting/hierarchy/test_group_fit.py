"""The record of a hierarchical fit, and what it refuses."""

from itertools import combinations

import numpy as np
import pandas as pd
import pytest
import xarray

from bgmodel.fit_trials import fit
from bgmodel.fitting.algorithms import GapModel
from bgmodel.fitting.hierarchy.chains import CHAINS, LARGEST_RHAT
from bgmodel.fitting.hierarchy.group_fit import fit_group
from bgmodel.fitting.person_fit import cells_of
from circuits.errors import FitWarning
from tests.drawn import drawn, rows_of
from tests.fitting.conftest import FIXED, MOST, SEED, short_chains, table
from tests.helpers import refused, refusing

GAP = {"model": "constant_gap", "strength": "strength", "fix": FIXED}


def test_there_is_one_row_per_parameter_of_the_group(group):
    summary = group.summary()
    assert summary.index.tolist() == ["sensitivity", "bound", "t0_s"]
    assert (summary["low"] < summary["median"]).all()
    assert (summary["median"] < summary["high"]).all()
    assert (summary["between_people"] > 0).all()
    assert group.group.shape == (CHAINS, MOST, 3)


def test_a_difference_of_a_parameter_with_itself_is_zero(group):
    difference = group.difference("bound", "bound")
    assert difference == {"median": 0.0, "low": 0.0, "high": 0.0, "above_zero": 0.0}
    assert group.difference("sensitivity", "bound")["above_zero"] == 1.0
    with refused("second"):
        group.difference("bound", "drift")


def test_short_chains_are_named_as_such(group):
    assert not group.agreement.reached
    (caution,) = group.cautions()
    assert f"{group.agreement.rhat.max():.3f}" in caution
    assert LARGEST_RHAT == 1.01


def test_log_likelihood_of_a_draw_is_that_of_its_parameters(group):
    likelihood = group.likelihoods["cleo"]
    vector = group.individual[1, 7, 2]
    assert group.log_likelihood[1, 7, 2] == pytest.approx(likelihood(vector))


def test_cells_are_those_at_the_medians_of_each_person(group):
    medians = group.to_dataframe().pivot(index="participant", columns="parameter", values="median")
    cells = group.cells().set_index("participant")
    for who, likelihood in group.likelihoods.items():
        vector = medians.loc[who, group.parameters].to_numpy()
        likelihood = likelihood.complete(vector)
        expected = cells_of(likelihood.design, likelihood.density(vector))
        assert cells.loc[who, "model_mean_s"] == pytest.approx(expected["model_mean_s"][0])
        assert cells.loc[who, "accuracy"] == expected["accuracy"][0]


def test_guesses_are_warned_of():
    some, rng = table(trials=100), np.random.default_rng(SEED)
    guess = rng.random(len(some)) < 0.3
    some.loc[guess, "rt"] = rng.uniform(0.15, 0.25, guess.sum())
    some.loc[guess, "response"] = rng.integers(0, 2, guess.sum())
    with short_chains(), pytest.warns(FitWarning) as warned:
        fit(some, **GAP, most_draws=MOST, people="hierarchical")
    assert [str(each.message) for each in warned if "does not fit" in str(each.message)]


def few(rows):
    """Return all trials of two people and the first of the others."""
    most = rows["participant_id"].map({"ben": 12, "cleo": 16}).fillna(60)
    return rows[rows.groupby("participant_id").cumcount() < most]


def early(rows):
    return rows[(rows["participant_id"] != "dora") | (rows["block"] == "early")]


def grouped(change, **options):
    return lambda: fit(change(table()), **GAP, **options, people="hierarchical")


test_people_who_do_not_fit_into_a_hierarchy_are_refused = refusing(
    (grouped(lambda rows: rows[rows["participant_id"].isin(["anna", "ben"])]), "participant"),
    (grouped(few), r"data .*ben \(12\), cleo \(16\)"),
    (grouped(early, vary={"bound": "block"}), "vary .*dora"),
)


def test_what_people_cannot_share_or_correlate_is_refused(group):
    for name in ("t0_sd_s", "gap"):  # one is fixed, the other is no parameter
        with refused("shared"):
            fit_group(group.likelihoods, shared=[name])
    with refused("correlated"):
        fit_group(group.likelihoods, correlated=True, shared=["bound", "t0_s"])


def two_groups(shift, seed=11):
    """Return people of two groups, whose bounds differ by a shift."""
    parts = []
    rng = np.random.default_rng(seed)
    for k in range(10):
        kind = "patient" if k % 2 else "control"
        bound = 0.8 + shift * (kind == "patient") + 0.06 * rng.standard_normal()
        some = drawn(GapModel(), [0.2], 60, 500 + k, seconds=2.0, sensitivity=8.0, bound=bound)
        parts.append(rows_of(some, participant_id=f"p{k}", kind=kind))
    return pd.concat(parts, ignore_index=True)


def test_a_predictor_between_people_finds_the_difference_of_their_groups():
    formula = ["bound ~ kind", "sensitivity ~ kind"]
    fitted = fit(two_groups(0.3), **GAP, formula=formula, people="hierarchical")
    assert fitted.agreement.reached
    effects = fitted.effects()
    bound = effects.loc["bound by kind[T.patient]"]
    assert bound["low"] < 0.3 < bound["high"]
    assert bound["above_zero"] > 0.99
    none = effects.loc["sensitivity by kind[T.patient]"]
    assert none["low"] < 0 < none["high"]
    assert "bound by kind[T.patient]" in fitted.to_datatree()["posterior"]


def predicted(people="hierarchical", **options):
    def fitted():
        rows = two_groups(0.3).assign(block=lambda t: np.where(t.index % 2, "a", "b"))
        fit(rows, **GAP, people=people, **options)

    return fitted


test_predictors_between_people_that_cannot_be_fitted_are_refused = refusing(
    (predicted("each", formula="bound ~ kind"), "kind"),
    (predicted(vary={"bound": "kind"}), "kind"),
    (predicted(formula="bound ~ kind * block"), "formula"),
    (predicted(formula="bound ~ 0 + kind"), "formula"),
)


@pytest.fixture(scope="module")
def related():
    """Return a fit with correlations and a prior that is much narrower than the data."""
    return short(prior={"t0_s": (0.2, 0.204)}, people="correlated")


def short(**options):
    with short_chains(), pytest.warns(FitWarning):
        return fit(table(), **GAP, most_draws=MOST, **options)


def test_a_narrow_prior_outweighs_the_data_and_a_wide_one_changes_nothing(group, related):
    def t0_s(fitted):
        return fitted.group[..., 2].ravel()

    assert abs(np.median(t0_s(related)) - 0.202) < 0.002
    assert np.median(t0_s(group)) > 0.25
    wide = short(prior={"t0_s": (0.05, 1.5)}, people="hierarchical")
    assert abs(np.median(t0_s(wide)) - np.median(t0_s(group))) < t0_s(group).std()
    assert t0_s(wide).std() == pytest.approx(t0_s(group).std(), rel=0.5)


def test_priors_and_correlations_are_in_the_result_and_its_file(group, related, tmp_path):
    pairs = related.correlations()
    assert "correlations between people" in related.summary()._repr_html_()
    assert pairs.index.tolist() == list(combinations(("sensitivity", "bound", "t0_s"), 2))
    draws = np.stack([each.correlation for each in related.chains])[..., 1, 0]
    assert pairs["low_95"].iloc[0] == np.quantile(draws, 0.025)
    assert (pairs["low_95"] < pairs["median"]).all()
    tree = xarray.open_datatree(related.to_netcdf(tmp_path / "fit.nc"), engine="h5netcdf")
    assert "0.2 to 0.204" in tree.attrs["notes"]
    assert np.array_equal(tree["posterior/correlation of sensitivity and bound"], draws)
    assert group.correlations().empty
    assert "prior" not in repr(group.summary())


def test_correlated_draws_do_not_depend_on_the_number_of_workers(related):
    with short_chains(), pytest.warns(FitWarning):
        again = fit_group(related.likelihoods, most_draws=MOST, correlated=True, workers=2)
    assert again.individual.tobytes() == related.individual.tobytes()
    assert again.correlations().equals(related.correlations())
