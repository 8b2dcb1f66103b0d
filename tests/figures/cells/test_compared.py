"""Comparisons of recorded cells: folds, regressions, and spikes given the choice alone."""

import numpy as np
import pytest

from bgmodel.fitting.cells.grid import SUMS, chosen, p_right
from bgmodel.fitting.cells.sessions import BIN_S, KNOTS
from figures.cells import compared
from tests.fitting.cells.test_model import clicked, likelihood_of, true_vector


@pytest.fixture(scope="module")
def likelihood():
    """Return that of one session under the exponential reading."""
    return likelihood_of(clicked(120))


def test_folds_have_every_trial_once(likelihood):
    every = list(compared.folds(likelihood))
    assert sorted(np.concatenate([each.left for each in every])) == list(range(120))
    for each in every:
        assert sorted([*each.left, *each.kept]) == list(range(120))
        assert len(each.left) == 24


def test_the_noise_of_every_bin_gives_the_probability_of_the_choice(likelihood):
    values = likelihood.values(true_vector(likelihood, noise=4.0)) | {"choice_noise": 2.0}
    (session,) = likelihood.sessions
    nodes, weights = np.polynomial.hermite_e.hermegauss(61)
    sums = session.sums(*(values[name] for name in SUMS))
    _, p = compared._given_choice(session, values, sums, nodes)
    exact = chosen(p_right(session, values), session)
    before = session.middles_s < session.end_s[:, None]
    share = (weights * p).sum(axis=2) / weights.sum()
    assert np.allclose(
        share[before], np.broadcast_to(exact[:, None], share.shape)[before], atol=0.01
    )


def test_without_gains_spikes_do_not_depend_on_the_choice(likelihood):
    vector = true_vector(likelihood, noise=4.0)
    for k, name in enumerate(likelihood.freedom.names):
        vector[k] = 0.0 if name.endswith("gain") else vector[k]
    (session,) = likelihood.sessions
    for k, (_, nats) in enumerate(compared._apart(likelihood, vector)):
        log = 2.0 + 0.2 * session.past[k] + np.log(BIN_S)
        exact = ((session.counts[k] * log - np.exp(log)) * session.on).sum()
        assert nats == pytest.approx(exact)


def test_a_regression_finds_the_numbers_of_its_cell(likelihood):
    trials = likelihood.simulated(true_vector(likelihood), np.random.default_rng(2))
    (session,) = likelihood_of(trials).sessions
    design = np.column_stack([compared._columns(session, "psth"), session.past[0][session.on]])
    numbers = compared._regression(design, session.counts[0][session.on])
    assert numbers[:KNOTS].mean() == pytest.approx(2.0 + np.log(BIN_S), abs=0.2)
    assert compared._columns(session, "clicks and choice").shape[1] == 2 * KNOTS + 1
