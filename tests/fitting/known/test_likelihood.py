"""The likelihood against its definition, and its limits."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import norm

from bgmodel.evidence import minus_log_softmax
from bgmodel.fitting.known.accumulation import runs_of_cues
from bgmodel.fitting.known.likelihood import known_likelihood, parameters_of
from bgmodel.fitting.known.models import EXACT
from circuits.errors import InputError
from tests.known_trials import few, simulated

VALUES = {
    "gain": 0.8, "leak_hz": 0.0, "threshold": 0.5, "noise": 0.2, "urgency": 0.3, "run_effect": 0.1,
    "bias_b": 0.1, "bias_c": -0.2, "t0_s": 0.2, "t0_sd_s": 0.06, "lapse": 0.05,
}  # fmt: skip


def vector_of(likelihood, values):
    return np.array([values[name] for name in likelihood.freedom.names])


def test_it_is_the_sum_over_readings_of_hazard_and_non_decision_time():
    trials = few()
    likelihood = known_likelihood(EXACT["msprt"], trials, free=list(VALUES))
    found = likelihood.each(vector_of(likelihood, VALUES))
    out = minus_log_softmax(0.8 * np.cumsum(trials.log_likelihood, axis=1))
    out = out - 0.1 * np.maximum(runs_of_cues(trials.log_likelihood) - 1, 0)
    for trial in range(trials.trials):
        alive, density = 1.0, 0.0
        for k in range(3):
            time_s = trials.time_s[trial, k]
            past = (0.5 + 0.3 * time_s + np.array([0, 0.1, -0.2]) - out[trial, k]) / 0.2
            hazard = np.exp(past) / (1 + np.exp(past).sum())
            late = norm.pdf(trials.rt_s[trial], time_s + 0.2, 0.06)
            density += alive * hazard[trials.choice[trial]] * late
            alive *= 1 - hazard.sum()
        expected = 0.95 * density + 0.05 / (3 * trials.rt_s.max())
        assert found[trial] == pytest.approx(np.log(expected))


def test_responses_and_none_have_probability_one_in_all():
    trials = few()
    late = np.linspace(0.001, 1.2, 2400)
    values = {**VALUES, "urgency": 0.0, "run_effect": 0.0, "lapse": 0.0}
    total = 0.0
    for rt_s in late[late > 0.3]:
        likelihood = known_likelihood(EXACT["msprt"], replace(trials, rt_s=np.full(20, rt_s)))
        density, none = likelihood.density(values)
        total = total + density.sum(axis=1) * (late[1] - late[0])
    # Responses before the last reading have seen fewer of them.
    for rt_s in late[late <= 0.3][100:]:
        some = replace(trials, rt_s=np.full(20, max(rt_s, 0.1001)))
        density, _ = known_likelihood(EXACT["msprt"], some).density(values)
        total = total + density.sum(axis=1) * (late[1] - late[0])
    np.testing.assert_allclose(total + none, 1.0, atol=0.01)


def test_a_trial_without_a_response_is_one_without_a_decision():
    trials = few()
    silent = replace(
        trials,
        choice=np.where(np.arange(20) < 5, -1, trials.choice),
        rt_s=np.where(np.arange(20) < 5, np.nan, trials.rt_s),
    )
    likelihood = known_likelihood(EXACT["msprt"], silent, free=list(VALUES))
    vector = vector_of(likelihood, VALUES)
    _, left = likelihood.decisions(VALUES)
    np.testing.assert_allclose(likelihood.each(vector)[:5], np.log(0.95 * left[:5]))
    other = known_likelihood(EXACT["msprt"], trials, free=list(VALUES)).each(vector)
    same_span = silent.span_s == trials.span_s
    assert not same_span or np.allclose(likelihood.each(vector)[5:], other[5:])


def test_two_alternatives_without_leak_and_noise_decide_alike_in_test_and_leaky_sum():
    trials = simulated(200)
    odds = 1.5
    values = {"leak_hz": 0.0, "urgency": 0.0, "run_effect": 0.0, "bias_1": 0.0, "gain": 1.0}
    test = known_likelihood(EXACT["msprt"], trials)
    leaky = known_likelihood(EXACT["leaky_sum"], trials)
    level = float(np.log1p(np.exp(-odds)))
    first, _ = test.decisions({**values, "threshold": level, "noise": 1e-7})
    second, _ = leaky.decisions({**values, "threshold": odds / 2, "noise": 1e-7})
    np.testing.assert_allclose(first, second, atol=1e-6)


@pytest.mark.parametrize("model", list(EXACT))
def test_evidence_common_to_all_alternatives_changes_nothing(model):
    trials = simulated(60)
    values = trials.log_likelihood + np.random.default_rng(1).normal(size=(60, 40, 1))
    moved = replace(trials, log_likelihood=values)
    first, second = (known_likelihood(EXACT[model], each) for each in (trials, moved))
    np.testing.assert_allclose(
        first.each(first.freedom.start), second.each(first.freedom.start), atol=1e-8
    )


def test_readings_after_the_response_change_nothing():
    trials = simulated(60)
    values = trials.log_likelihood.copy()
    values[np.arange(40) >= trials.seen[:, None]] = 9.0
    moved = replace(trials, log_likelihood=values)
    first, second = (known_likelihood(EXACT["msprt"], each) for each in (trials, moved))
    np.testing.assert_array_equal(first.each(first.freedom.start), second.each(first.freedom.start))


def test_the_choice_given_the_time_is_a_probability():
    likelihood = known_likelihood(EXACT["msprt"], simulated(60))
    chosen = likelihood.chosen(likelihood.freedom.start)
    np.testing.assert_allclose(chosen.sum(axis=1), 1.0)


def test_options_add_to_replace_and_fix_parameters():
    trials = simulated(60)
    names = known_likelihood(EXACT["msprt"], trials).freedom.names
    assert "gain" not in names
    assert "bias_1" in names
    added = known_likelihood(EXACT["msprt"], trials, free=["+gain"]).freedom.names
    assert set(added) == {*names, "gain"}
    fixed = known_likelihood(EXACT["msprt"], trials, fixed={"lapse": 0.1})
    assert "lapse" not in fixed.freedom.names
    assert fixed.values(fixed.freedom.start)["lapse"] == 0.1
    assert "gain" in known_likelihood(EXACT["msprt"], few()).freedom.names
    with pytest.raises(InputError):
        known_likelihood(EXACT["run"], trials, free=["gain"])


def test_each_alternative_but_the_first_has_a_bias():
    names = [each.name for each in parameters_of(EXACT["run"], few())]
    assert [name for name in names if name.startswith("bias_")] == ["bias_b", "bias_c"]
