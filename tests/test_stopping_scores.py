"""Parts of the scores of stopping whose answers are known."""

import numpy as np
import pytest

from bgmodel.integrators.sprt import Msprt
from bgmodel.stopping.observer import StopMsprt, log_odds_of_stop
from figures.stopping.observer import abrupt, commitments, decisions, observed, with_tone
from figures.stopping.runs import agreement, evidence_of

NONE = np.nan


def test_agreement_counts_outcomes_and_compares_times_of_those_that_responded_in_both():
    one = np.array([*np.arange(40.0), NONE, NONE])
    scores = agreement(one, np.append(one[:-1] - 3, 7.0))
    assert scores["same"] == pytest.approx(41 / 42)
    chance = (40 * 41 + 2 * 1) / 42**2
    assert scores["same_chance"] == pytest.approx(chance)
    assert scores["same_corrected"] == pytest.approx((41 / 42 - chance) / (1 - chance))
    assert (scores["times_r"], scores["times_ms"]) == (pytest.approx(1.0), pytest.approx(3.0))


def test_common_input_raises_s_and_changes_no_posterior():
    plain = evidence_of("tone", 20, 4)
    raised = with_tone(plain, 2.0)
    s = [np.logaddexp.reduce(each.own_totals[:, 40], axis=1) for each in (plain, raised)]
    assert s[1] - s[0] == pytest.approx(2.0)
    outs = [Msprt().run(each).out_nats for each in (plain, raised)]
    assert outs[0] == pytest.approx(outs[1])


def test_log_odds_jump_at_the_delay_and_add_what_is_wanted():
    go = evidence_of("tone", 10, 4)
    with_stops = abrupt(go, 800.0, float(np.log(np.expm1(1.0))))
    z = log_odds_of_stop(with_stops)
    assert z[:, 1:81] == pytest.approx(-30.0)
    assert z[:, 81:] == pytest.approx(z[0, 81])
    added = StopMsprt().run(with_stops).out_nats[..., :4] - Msprt().run(go).out_nats
    assert added[:, 90] == pytest.approx(1.0)


def test_the_observer_withholds_in_stop_trials_and_not_before_the_signal():
    go = evidence_of("observer", 200)
    ssd = np.full(200, 100.0)
    made = decisions(observed(go, ssd, 0.25, "stop", np.array([100.0])), 0.55)
    late = commitments(made, 2)
    assert np.isfinite(late).mean() > 0.9
    assert late.min() >= 100
