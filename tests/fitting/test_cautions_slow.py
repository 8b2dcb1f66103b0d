"""Slow trials among those of a fit: said where there are some, and only there."""

import warnings

import pytest

from bgmodel.fitting.algorithms import GapModel
from bgmodel.fitting.cautions import slow_trials
from bgmodel.fitting.design import design_of
from bgmodel.fitting.likelihood import likelihood_of
from bgmodel.fitting.person_fit import fit_likelihood
from tests.drawn import drawn, slowed

pytestmark = pytest.mark.usefixtures("brief_search")
MODEL, SEED = GapModel(), 84
CLEAN = drawn(MODEL, [0.0, 0.1, 0.4], 200, SEED, seconds=4.0, sensitivity=12.0, bound=0.7)
SLOWED = slowed(CLEAN, SEED)


def fitted(some, **options):
    """Return a fit, and the warnings of slow trials."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        fit = fit_likelihood(likelihood_of(MODEL, design_of(some), **options))
    return fit, [str(each.message) for each in caught if "slower" in str(each.message)]


@pytest.fixture(scope="module")
def slow_fit():
    return fitted(SLOWED)


def test_a_clean_set_has_no_slow_trials():
    fit, texts = fitted(CLEAN)
    assert texts == []
    assert slow_trials(fit.optimum).gain_nats < 0.5


def test_a_tail_of_slow_trials_is_said_with_their_number(slow_fit):
    """Of 600 trials 5 % have an exponential delay, and lapses take up a part of them."""
    fit, (text,) = slow_fit
    slow = slow_trials(fit.optimum)
    assert slow.gain_nats > 1
    assert text.startswith(f"all, constant_gap: about {round(600 * slow.share)} of 600 trials are")
    assert 0.005 <= slow.share <= 0.08
    assert "rt_window" in text
    assert "free lapse, which" not in text


def test_where_lapses_are_held_it_is_advised_to_free_them_and_that_helps(slow_fit):
    held, (text,) = fitted(SLOWED, fixed={"lapse": 0.001})
    assert "free lapse, which" in text
    free, _ = slow_fit
    off = [abs(each.optimum.values["bound"] - 0.7) for each in (free, held)]
    assert off[0] < off[1] / 2
