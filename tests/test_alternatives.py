"""Parts of scores whose answers are known: of many alternatives, and of stopping."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from bgmodel import Msprt, stream
from bgmodel.comparison.thresholds import MSPRT, MSPRT_AT_GAIN
from bgmodel.deciding.tradeoff import tradeoff
from bgmodel.simulated_evidence import separated_evidence
from bgmodel.stopping.observer import StopMsprt, log_odds_of_stop
from figures.decisions import measure_calibrated as calibrated
from figures.decisions import measure_hick as hick
from figures.published_circuits import measure_others as others
from figures.stopping.observer import abrupt, commitments, decisions, observed, with_tone
from figures.stopping.runs import agreement, evidence_of


def gaussian(trials=3000, hypotheses=4):
    rng = stream(1, "alternatives")
    return separated_evidence(trials, 100, 0.5, rng=rng, hypotheses=hypotheses, step_ms=50)


def test_times_on_a_line_over_ln_n_give_it_back():
    counts = np.array([2, 4, 8, 16])
    ms = 100 + 300 * np.log(counts)
    rows = {"time_ms": ms, "time_ms_low": ms - 10, "time_ms_high": ms + 10, "accuracy": 0.95}
    nothing = {f"longer_ms{end}": np.nan for end in ("", "_low", "_high")}
    known = {"evidence": "Gaussian", "decider": "a", "alternatives": counts}
    (line,) = hick.lines(pd.DataFrame(rows | nothing | known)).to_dict("records")
    assert line["slope_ms"] == pytest.approx(300)
    assert line["intercept_ms"] == pytest.approx(100)
    assert line["pearson_r"] == pytest.approx(1)
    assert line["chi2_p"] == pytest.approx(1)


def test_a_decider_takes_no_longer_than_itself_and_a_later_one_by_what_it_is_late():
    evidence = gaussian()
    test = tradeoff(Msprt(0.5).run(evidence), evidence)
    late = replace(test, time_ms=test.time_ms + 70)
    rows = hick.at_accuracies({MSPRT: test, MSPRT_AT_GAIN: test, "late": late})
    known = rows.dropna(subset=["longer_ms"]).set_index("decider")["longer_ms"]
    assert known[MSPRT].to_numpy() == pytest.approx(0, abs=1e-5)
    assert known["late"].to_numpy() == pytest.approx(70, abs=1e-5)


@pytest.mark.parametrize(("sure", "kept"), [(1.0, True), (2.0, False)])
def test_errors_stay_below_what_a_criterion_allows_where_likelihoods_are_right(sure, kept):
    """Control: log-likelihoods that are twice the right ones."""
    evidence = gaussian()
    evidence = replace(evidence, log_likelihood=sure * evidence.log_likelihood)
    calibration = calibrated.criteria(evidence, np.arange(evidence.trials))
    assert (1 - calibration["accuracy"] <= 1 - calibration["criterion"]).all() == kept
    assert (calibration["excess_high"] >= 0).all() == kept


@pytest.mark.parametrize(
    ("sign", "low", "high", "outcome"),
    [
        (1, 2.1, 5, others.AGREES),
        (1, 1, 5, others.OPEN),
        (1, -3, 1, others.DISAGREES),
        (-1, -5, -2.1, others.AGREES),
        (-1, -1, 3, others.DISAGREES),
        (1, np.nan, np.nan, others.OPEN),
    ],
)
def test_a_change_is_as_expected_where_its_whole_interval_says_so(sign, low, high, outcome):
    assert others.outcome(others.Expected("mean_percent", sign, 2.0), low, high) == outcome


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
