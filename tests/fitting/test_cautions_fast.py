"""Fast trials that were left out before a fit: said where they were, and only there."""

from dataclasses import replace

import numpy as np
import pytest

from bgmodel.fitting.algorithms import GapModel
from bgmodel.fitting.cautions import EDGE_NATS, cut_nats, of_cuts
from bgmodel.fitting.design import design_of
from bgmodel.fitting.likelihood import likelihood_of
from bgmodel.fitting.person_fit import fit_likelihood
from tests.drawn import TRUTH, drawn
from tests.helpers import told

pytestmark = pytest.mark.usefixtures("brief_search")
MODEL, SEED = GapModel(), 87
TRUE = {"sensitivity": 12.0, "bound": 0.7, **TRUTH}
CLEAN = drawn(MODEL, [0.0, 0.1, 0.4], 250, SEED, seconds=4.0, **TRUE)


def fitted(some, **options):
    """Return a fit and what it says about an abrupt beginning."""
    found = []
    texts = told(
        lambda: found.append(fit_likelihood(likelihood_of(MODEL, design_of(some, **options))))
    )
    return found[0], [text for text in texts if "abruptly" in text]


def test_a_clean_set_is_not_said_to_begin_abruptly():
    fit, texts = fitted(CLEAN)
    assert texts == []
    assert cut_nats(fit.optimum) < 2


@pytest.mark.parametrize("share", [0.2, 0.35])
def test_fast_trials_that_were_left_out_are_asked_for_and_the_window_mends_the_fit(share):
    """With the window the truth is as likely as it should be, and without it impossible."""
    first_s = float(np.quantile(CLEAN.rt_s, share))
    kept = CLEAN.where(first_s <= CLEAN.rt_s)
    off, (text,) = fitted(kept)
    assert f"all at {kept.rt_s.min():.4g} s" in text
    mended, texts = fitted(kept, rt_window=(first_s, np.inf))
    assert texts == []
    worse = [
        fit.log_likelihood
        - fit.optimum.likelihood(np.array([TRUE[name] for name in fit.optimum.values]))
        for fit in (off, mended)
    ]
    assert worse[0] > 50
    assert worse[1] < 5.5  # half of the 95 % point of chi-square, 5 degrees of freedom
    assert mended.optimum.values["bound"] == pytest.approx(0.7, abs=0.04)
    assert mended.log_likelihood - off.log_likelihood > cut_nats(off.optimum) > EDGE_NATS


def test_the_window_of_rounded_times_begins_half_a_step_earlier():
    first_s = round(float(np.quantile(CLEAN.rt_s, 0.3)), 2)
    rounded = replace(CLEAN, rt_s=np.round(CLEAN.rt_s, 2))
    kept = rounded.where(rounded.rt_s >= first_s)
    _, (text,) = fitted(kept)
    assert f"all at {first_s - 0.005:.4g} s" in text
    right, texts = fitted(kept, rt_window=(first_s - 0.005, np.inf))
    assert texts == []
    late, _ = fitted(kept, rt_window=(first_s, np.inf))
    off = [abs(fit.optimum.values["t0_s"] - TRUE["t0_s"]) for fit in (right, late)]
    assert off[0] < off[1]


def test_times_in_coarse_steps_are_not_taken_to_begin_abruptly():
    some = drawn(MODEL, [0.05, 0.1, 0.2, 0.4], 400, 12, seconds=3, sensitivity=10.0, bound=0.5)
    _, texts = fitted(replace(some, rt_s=np.ceil(10 * some.rt_s) / 10))
    assert texts == []


def test_a_warning_names_a_few_people_of_many():
    optimum = fitted(CLEAN.where(np.quantile(CLEAN.rt_s, 0.3) <= CLEAN.rt_s))[0].optimum
    (text,) = of_cuts([optimum] * 9)
    assert (text.count("all at"), text.count(" and 5 more: ")) == (4, 1)
