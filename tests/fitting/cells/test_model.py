"""Fits of recorded cells and choices: encodings, recovery, parts, negative controls."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

import bgmodel as bg
from bgmodel.fit_trials import question
from bgmodel.fitting.cells.model import numbers_of
from bgmodel.fitting.likelihood import Likelihood
from bgmodel.fitting.optimum import optimum
from bgmodel.fitting.settings import settings_of
from circuits.errors import quiet
from tests.helpers import refused
from tests.trials.test_spikes import NAMED


def clicked(trials=300, cells=3, seed=2):
    """Return trials with clicks, whose choices and spikes are yet to be simulated."""
    rng = np.random.default_rng(seed)
    rows, spikes = [], []
    for k in range(trials):
        end, odds = rng.uniform(0.3, 1.0), rng.choice([0.2, 0.4, 0.6, 0.8])
        times = np.sort(rng.uniform(0, end, rng.poisson(40 * end)))
        right = rng.random(len(times)) < odds
        row = {"trial": k, "stimulus_s": end, "left_s": [0.0, *times[~right]]}
        more = int(right.sum() > (~right).sum())
        rows.append(row | {"right_s": [0.0, *times[right]], "chose_right": more})
        for cell in range(cells):
            when = rng.uniform(-0.5, 1.0, 10)
            spikes.append(pd.DataFrame({"cell": cell, "trial": k, "time_s": when}))
    table = pd.DataFrame(rows)
    return bg.read_trials(table, columns=NAMED, spikes=pd.concat(spikes, ignore_index=True))


def likelihood_of(trials, model="exponential", **options):
    one = question(settings_of(**options), trials, [model], alone=True)
    return one.likelihoods(model)["all"]


def true_vector(likelihood, gains=(0.08, -0.08, 0.0), **values):
    """Return the default with some values, and these gains in turn."""
    vector = likelihood.freedom.start.copy()
    names = likelihood.freedom.names
    for session in likelihood.sessions:
        for k, cell in enumerate(session.names):
            for name in numbers_of(cell):
                vector[names.index(name)] = 2.0 if "course" in name else 0.2
            values[f"{cell} gain"] = gains[k % len(gains)]
    for name, value in values.items():
        vector[names.index(name)] = value
    return vector


@pytest.fixture(scope="module")
def simulated():
    """Return true numbers, and the likelihood and the trials simulated with them."""
    likelihood = likelihood_of(clicked())
    vector = true_vector(likelihood, noise=4.0, lapse=0.05)
    trials = likelihood.simulated(vector, np.random.default_rng(4))
    return vector, likelihood_of(trials), trials


def test_a_circuit_needs_a_nucleus():
    with refused("models"):
        likelihood_of(clicked(30), bg.load_circuit("macaque", 2))


def test_a_part_has_the_densities_of_its_trials(simulated):
    vector, likelihood, _ = simulated
    some = np.arange(0, 300, 7)
    part = likelihood.part(some)
    assert np.allclose(part.each(vector), likelihood.each(vector)[some])
    assert np.allclose(part.part(np.arange(5)).each(vector), likelihood.each(vector)[some[:5]])
    assert np.allclose(part.choices(vector), likelihood.choices(vector)[some])


def test_a_trial_without_a_choice_is_simulated_without_one(simulated):
    vector, _, trials = simulated
    choice = np.where(np.arange(300) < 100, -1, trials.readings.choice)
    rt_s = np.where(choice < 0, np.nan, trials.rt_s)
    readings = replace(trials.readings, choice=choice)
    some = replace(trials, readings=readings, response=choice.astype(np.int8), rt_s=rt_s)
    likelihood = likelihood_of(some)
    made = likelihood.simulated(vector, np.random.default_rng(5))
    assert ((made.readings.choice < 0) == (choice < 0)).all()
    answered = likelihood.density(vector).sum() * likelihood.design.grid.width_s
    assert answered == pytest.approx((choice >= 0).sum() / likelihood.design.trials.sum())


def test_scores_are_derivatives_of_each_trial(simulated):
    vector, likelihood, _ = simulated
    scores = likelihood.scores(vector)
    for k in (0, 2, 4, 5, len(vector) - 1):
        away = 1e-4 * np.eye(len(vector))[k]
        apart = (likelihood.each(vector + away) - likelihood.each(vector - away)) / 2e-4
        assert np.allclose(scores[:, k], apart, atol=5e-3)


def fitted(likelihood):
    """Return the optimum and the standard errors there."""
    with quiet():
        peak = optimum(likelihood)
    return peak, np.sqrt(np.diag(np.linalg.inv(likelihood.information(peak.vector)[0])))


def test_simulated_numbers_are_recovered(simulated):
    vector, likelihood, _ = simulated
    peak, error = fitted(likelihood)
    assert peak.log_likelihood > likelihood(vector)
    names = likelihood.freedom.names
    some = [k for k, name in enumerate(names) if "gain" in name or name in ("noise", "bias")]
    assert (np.abs(peak.vector - vector)[some] < 3.5 * error[some]).all()


def without_noise(trials, effect=0.0):
    """Return the likelihood without noise of the sum, with a fixed leak and effect of the past."""
    fixed = {"noise": 0.02, "start_noise": 0.02, "leak_per_s": 1.0}
    past = {f"{cell} past": effect for cell in trials.spikes.names}
    return likelihood_of(trials, fix=fixed | past, free=["+choice_noise"])


def test_spikes_of_other_trials_have_no_gain_by_clicks():
    """Noise of the sum makes the spikes of a trial vary together, which errors have to allow for.

    The fit is without that noise, which would take up what cells share whatever the clicks.
    """
    likelihood = likelihood_of(clicked(cells=2))
    loud = true_vector(likelihood, noise=20.0, leak_per_s=3.0)
    trials, z = likelihood.simulated(loud, np.random.default_rng(4)), []
    for seed in range(5):
        order = np.random.default_rng(seed).permutation(trials.trials)
        shuffled = replace(trials, spikes=replace(trials.spikes, trial=order[trials.spikes.trial]))
        each = without_noise(shuffled)
        peak, error = fitted(each)
        poisson = 1 / np.sqrt(np.diag(Likelihood.information(each, peak.vector)[0]))
        gains = [k for k, name in enumerate(each.freedom.names) if "gain" in name]
        z += [peak.vector[gains] / np.stack([error, poisson])[:, gains]]
    beyond = (np.abs(z) > 2).mean(axis=(0, 2))
    assert beyond[0] < 0.15
    assert beyond[1] > 0.4


def test_spikes_counted_twice_give_no_smaller_errors(simulated):
    likelihood = without_noise(simulated[2])
    peak, error = fitted(likelihood)
    twice = tuple(replace(one, counts=2 * one.counts) for one in likelihood.sessions)
    names, vector = np.array(likelihood.freedom.names), peak.vector.copy()
    vector[np.char.find(names, "course") >= 0] += np.log(2)
    doubled = replace(likelihood, sessions=twice)
    again = np.sqrt(np.diag(np.linalg.inv(doubled.information(vector)[0])))
    gains = np.char.endswith(names, "gain")
    assert np.allclose(again[gains], error[gains], rtol=0.1)


def test_the_front_door_returns_a_fit(simulated):
    _, _, trials = simulated
    with quiet():
        fit = bg.fit(trials, "linear")
    assert {"noise", "lapse", "0 gain", "2 past"} <= set(fit.parameters()["parameter"])
    assert np.isfinite(fit.log_likelihood)
    assert fit.cells().shape[0] == 1
    for name in ("runs", "noise_nats", "seed"):  # settings without an effect
        with refused(name):
            bg.fit(trials, "linear", **{name: 3})


def test_a_start_is_the_regression_given_what_is_fixed(simulated):
    """A regression with another effect of the past would start with courses for that one."""
    for effect in (0.0, 0.2):
        likelihood = without_noise(simulated[2], effect)
        slope = likelihood.scores(likelihood.starts()[0]).sum(axis=0)
        of_cells = [k for k, name in enumerate(likelihood.freedom.names) if name[0].isdigit()]
        assert np.abs(slope[of_cells]).max() < 1.0


LEAKY = {"noise": 20.0, "leak_per_s": 18.0, "start_noise": 0.1, "gains": (0.5, -0.5)}


def test_a_fit_starts_with_and_without_a_leak_and_ends_at_the_higher_peak():
    """With strong gains on a leaky sum, the start with hardly a leak often ends far lower.

    Whether it does in a given set depends on the last bits, and so on the processor.
    """
    likelihood = likelihood_of(clicked(trials=60, cells=2))
    true = true_vector(likelihood, **LEAKY)
    lower = []
    for seed in (2, 3):
        data = likelihood_of(likelihood.simulated(true, np.random.default_rng(seed)))
        heights = [optimum(data, starts=[each]).log_likelihood for each in data.starts()]
        assert optimum(data).log_likelihood == max(heights)
        lower.append(max(heights) - heights[-1])
    assert max(lower) > 400


def test_where_the_likelihood_is_flat_a_search_goes_on():
    """A search comes to a point at which no trial's likelihood depends on the bias."""
    likelihood = likelihood_of(clicked(trials=150, cells=4))
    true = true_vector(likelihood, **LEAKY, deciding_noise=4.0, deciding_leak_per_s=-1.0)
    data = likelihood_of(likelihood.simulated(true, np.random.default_rng(3)))
    assert np.isfinite(optimum(data, starts=data.starts()[-1:]).log_likelihood)
