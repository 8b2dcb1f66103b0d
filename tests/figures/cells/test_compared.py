"""Comparisons of recorded cells: folds, regressions, and spikes given the choice alone."""

import numpy as np
import pytest

from bgmodel.fitting.cells.density import SUMS, chosen, moved, p_right
from bgmodel.fitting.cells.model import SHARED
from bgmodel.fitting.cells.sessions import BIN_S, KNOTS
from circuits.errors import quiet
from figures.cells import compared
from tests.fitting.cells.test_model import clicked, likelihood_of, true_vector

OF_SUMS = {each.name for each in SHARED if each.free}


@pytest.fixture(scope="module")
def likelihood():
    """Return that of one session under the exponential reading."""
    return likelihood_of(clicked(120))


def test_folds_have_every_trial_once_in_a_row(likelihood):
    every = list(compared.folds(likelihood))
    assert sorted(np.concatenate([each.left for each in every])) == list(range(120))
    for each in every:
        assert sorted([*each.left, *each.kept]) == list(range(120))
        assert np.ptp(each.left) == len(each.left) - 1 == 23


def test_the_noise_of_every_bin_gives_the_probability_of_the_choice(likelihood):
    values = likelihood.values(true_vector(likelihood, noise=4.0)) | {"choice_noise": 2.0}
    (session,) = likelihood.sessions
    nodes, weights = np.polynomial.hermite_e.hermegauss(61)
    _, p = compared._given_choice(session, values, nodes)
    exact = chosen(p_right(session, values), session)
    before = session.middles_s < session.end_s[:, None]
    share = (weights * p).sum(axis=2) / weights.sum()
    assert np.allclose(
        share[before], np.broadcast_to(exact[:, None], share.shape)[before], atol=0.01
    )


def test_a_regression_finds_the_numbers_of_its_cell(likelihood):
    trials = likelihood.simulated(true_vector(likelihood), np.random.default_rng(2))
    (session,) = likelihood_of(trials).sessions
    design = compared._columns(session, "psth", 0)
    numbers = compared._regression(design, session.counts[0][session.on])
    assert numbers[:KNOTS].mean() == pytest.approx(2.0 + np.log(BIN_S), abs=0.2)
    assert compared._columns(session, "clicks and choice", None).shape[1] == 2 * KNOTS + 1


def test_expected_rates_are_means_over_paths_given_the_choice(likelihood):
    """Simulated paths that end with the choice of a trial have the rate that is expected."""
    vector = true_vector(likelihood, noise=4.0, lapse=0.05)
    values, rng, paths = likelihood.values(vector), np.random.default_rng(6), 40_000
    (session,) = likelihood.sessions
    left, added = moved(values["leak_per_s"], values["noise"], BIN_S / 2)
    noise = rng.normal(0, np.sqrt((left * values["start_noise"]) ** 2 + added), paths)
    left, added = moved(values["leak_per_s"], values["noise"], session.end_s[0] - BIN_S / 2)
    sums = session.sums(*(values[name] for name in SUMS))[0]
    end = left * noise + rng.normal(0, np.sqrt(added), paths) + sums[-1] + values["bias"]
    right = np.where(rng.random(paths) < values["lapse"], rng.random(paths) < 0.5, end > 0)
    _, _, mean = next(iter(compared.expected(likelihood, vector)))
    base = 2.0 + 0.2 * session.past[0][0, 0] + np.log(BIN_S)
    rate = np.exp(base + 0.08 * (sums[0] + noise[right == session.choice[0]]))
    assert mean[0] == pytest.approx(rate.mean(), abs=4 * rate.std() / np.sqrt(len(rate)))


def test_choices_of_other_trials_are_not_told_by_spikes(monkeypatch, likelihood):
    """They depend on spikes of the same trials; the fits to both have the same spikes."""
    trials = likelihood.simulated(
        true_vector(likelihood, noise=8.0, **{"0 gain": 0.3}), np.random.default_rng(3)
    )
    monkeypatch.setattr(compared, "trials_of", lambda folder: trials)
    with quiet():
        recorded = compared.scored("", compared.REFERENCE)
        elsewhere = compared.chosen_elsewhere("", 4)
    assert recorded["told"].sum() > 3
    assert elsewhere["told"].sum() < 1
    assert set(recorded["cell"].dropna()) == set(likelihood.sessions[0].names)


def test_choices_alone_follow_the_clicks(monkeypatch, likelihood):
    vector = true_vector(likelihood, deciding_noise=1.0)
    trials = likelihood.simulated(vector, np.random.default_rng(3))
    monkeypatch.setattr(compared, "trials_of", lambda folder: trials)
    alone = compared.chosen_alone("")
    assert alone["choices"].sum() > 0.8 * 120 * np.log(0.5)
    assert alone["deciding_noise"].iloc[0] < 4


def test_errors_of_recovered_numbers_are_in_standard_errors(monkeypatch, likelihood):
    vector = true_vector(likelihood, noise=8.0, deciding_noise=2.0, **{"0 gain": 0.3})
    trials = likelihood.simulated(vector, np.random.default_rng(3))
    true = dict(zip(likelihood.freedom.names, vector, strict=True))
    monkeypatch.setattr(compared, "trials_of", lambda folder: trials)
    monkeypatch.setattr(compared, "reference_of", lambda folder: true)
    with quiet():
        z = compared.recovered("", 0, seed=5, sets=1).groupby("number")["z"]
    assert set(z.groups) == {"gain", "past", "course", *OF_SUMS}
    assert z.size()["gain"] == 3
    assert 0.3 < z.std()["course"] < 3


def test_cells_follow_the_clicks_of_their_own_trials_alone(likelihood, monkeypatch):
    vector = true_vector(likelihood, noise=0.02, start_noise=0.02)
    vector[np.char.endswith(likelihood.freedom.names, "gain")] *= 3
    trials = likelihood.simulated(vector, np.random.default_rng(7))
    monkeypatch.setattr(compared, "trials_of", lambda _: trials)
    with quiet():
        gains = compared.controls("", 3, shuffles=2)
    beyond = (gains["gain"] / gains["error"]).abs().gt(2.5).groupby(gains["shuffle"]).sum()
    assert beyond.tolist() == [2, 0, 0]  # the third of the cells has no gain
