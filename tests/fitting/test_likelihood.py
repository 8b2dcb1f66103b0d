"""A model of trials from a user's script: fitted, compared, in a hierarchy and checked."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from scipy.special import expit
from scipy.stats import norm

import bgmodel as bg
from bgmodel.fitting.design import design_of
from bgmodel.fitting.likelihood import likelihood_of
from bgmodel.fitting.optimum import optimum
from bgmodel.fitting.parameters import Parameter
from bgmodel.fitting.posterior import directions
from bgmodel.trials.record import Trials
from circuits.errors import FitWarning
from tests.drawn import rows_of
from tests.helpers import refused


class LogNormal:
    """Trials are logistic in strength; times are log-normal, faster for stronger evidence."""

    name = "log-normal"
    parameters = (
        Parameter("slope", 0.0, 20.0, 2.0, "log odds per unit of strength"),
        Parameter("level", -3.0, 2.0, -1.0, "mean of log times at strength 0, log s"),
        Parameter("gain", -3.0, 3.0, 0.0, "by which it falls per unit of strength"),
        Parameter("spread", 0.02, 2.0, 0.3, "standard deviation of log times", scale="log"),
    )

    @staticmethod
    def middle(trials, values):
        return values["level"] - values["gain"] * np.abs(trials.strength)

    def log_density(self, trials, values):
        sign = 2 * trials.response - 1
        choice = np.log(expit(sign * values["slope"] * trials.strength))
        log = np.log(trials.rt_s)
        return choice + norm.logpdf(log, self.middle(trials, values), values["spread"]) - log

    def simulate(self, trials, values, rng):
        response = rng.random(trials.trials) < expit(values["slope"] * trials.strength)
        log = self.middle(trials, values) + values["spread"] * rng.standard_normal(trials.trials)
        return replace(trials, response=response.astype(np.int8), rt_s=np.exp(log))


MODEL = LogNormal()
TRUTH = {"slope": 3.0, "level": -0.5, "gain": 0.6, "spread": 0.25}


def people(count=1, trials=400, seed=3, spread=0.0):
    """Return a table of people who differ in level."""
    rng = np.random.default_rng(seed)
    parts = []
    for k in range(count):
        strength = rng.choice([-0.8, -0.4, -0.1, 0.1, 0.4, 0.8], trials)
        ones, none = np.ones(trials, np.int8), pd.DataFrame(index=range(trials))
        blank = Trials(np.full(trials, f"p{k}"), 1.0 * ones, ones, strength, none)
        values = {**TRUTH, "level": TRUTH["level"] + spread * rng.standard_normal()}
        made = MODEL.simulate(blank, {n: np.full(trials, v) for n, v in values.items()}, rng)
        parts.append(rows_of(made, participant_id=f"p{k}"))
    return pd.concat(parts, ignore_index=True)


def test_estimates_and_errors_are_those_in_closed_form_and_the_model_fits():
    """Times are a regression of logarithms, which least squares solves."""
    table = people(trials=2_000)
    fit = bg.fit(table, MODEL, strength="strength", draws=True)
    log, x = np.log(table["rt"]), np.column_stack([np.ones(2_000), -table["strength"].abs()])
    (level, gain), residual, *_ = np.linalg.lstsq(x, log, rcond=None)
    peak, values = fit.optimum, fit.optimum.values
    assert [values["level"], values["gain"]] == pytest.approx([level, gain], abs=1e-4)
    assert values["spread"] == pytest.approx(np.sqrt(residual[0] / 2_000), rel=1e-3)
    assert peak.likelihood.each(peak.vector).sum() == pytest.approx(peak.log_likelihood)
    errors = fit.parameters().set_index("parameter")["standard_error"]
    exact = np.sqrt(np.diag(np.linalg.inv(x.T @ x))) * values["spread"]
    assert errors[["level", "gain"]].to_numpy() == pytest.approx(exact, rel=0.1)
    assert fit.posterior.draws.std(axis=0) == pytest.approx(errors.to_numpy(), rel=0.15)
    assert min(fit.misfit.p.values()) > 0.001
    cells = fit.cells()
    expected = expit(TRUTH["slope"] * cells["strength"])
    np.testing.assert_allclose(cells["model_accuracy"], expected, atol=0.03)
    assert fit.plot().axes


def test_a_wrong_model_is_said_not_to_fit():
    table = people(trials=2_000)
    table["rt"] = np.where(table["strength"].abs() > 0.5, 2 * table["rt"], table["rt"] / 2)

    class Level(LogNormal):
        parameters = tuple(each for each in MODEL.parameters if each.name != "gain")

        @staticmethod
        def middle(trials, values):
            return values["level"]

    with pytest.warns(FitWarning):
        fit = bg.fit(table, Level(), strength="strength")
    assert min(fit.misfit.p.values()) < 1e-6


def test_conditions_change_a_parameter():
    table = people(trials=800)
    table["block"] = np.where(np.arange(800) % 2, "b", "a")
    table.loc[table["block"] == "b", "rt"] *= np.exp(0.3)
    levels = bg.fit(table, MODEL, strength="strength", vary={"level": "block"}).optimum.values
    assert levels["level[block=b]"] - levels["level[block=a]"] == pytest.approx(0.3, abs=0.05)
    linear = bg.fit(table, MODEL, strength="strength", formula="level ~ block").optimum.values
    assert linear["level[block[T.b]]"] == pytest.approx(0.3, abs=0.05)


@pytest.mark.usefixtures("few_moves")
def test_people_are_fitted_in_a_hierarchy():
    some, fixed = people(8, 60, seed=5, spread=0.2), {"slope": 3.0, "gain": 0.6}
    group = bg.fit(some, MODEL, strength="strength", fix=fixed, people="hierarchical")
    table = group.summary()
    assert group.agreement.reached
    assert table.loc["level", "low"] < TRUTH["level"] < table.loc["level", "high"]
    assert 0.05 < table.loc["level", "between_people"] < 0.5
    tree = group.to_datatree()
    assert tree["posterior_predictive"]["rt"].shape == tree["log_likelihood"]["rt"].shape


def test_a_prior_pulls_an_estimate_as_its_precision_says():
    """Gaussian times 1 / spread^2 in the data, 1 / sd^2 in the prior: the mean is weighted."""
    table = people(trials=60)
    design = design_of(bg.read_trials(table, strength="strength"))
    fixed = {"slope": 3.0, "gain": 0.6, "spread": 0.25}
    free = optimum(likelihood_of(MODEL, design, fixed=fixed)).values["level"]

    class Prior(LogNormal):
        parameters = tuple(
            replace(each, prior=(0.5, 0.05)) if each.name == "level" else each
            for each in MODEL.parameters
        )

    peak = optimum(likelihood_of(Prior(), design, fixed=fixed))
    data, prior = 60 / 0.25**2, 1 / 0.05**2
    mean = (data * free + prior * 0.5) / (data + prior)
    assert peak.values["level"] == pytest.approx(mean, abs=1e-4)
    # The information of these data is the sum of squared scores, and the prior adds its precision.
    of_data, _ = peak.likelihood.information(peak.vector)
    with_prior = directions(peak.likelihood, peak.vector)
    assert with_prior.information[0, 0] - of_data[0, 0] == pytest.approx(prior, rel=1e-6)
    assert with_prior.standard_errors[0] == pytest.approx((of_data[0, 0] + prior) ** -0.5, rel=1e-6)


@pytest.mark.parametrize("wrong", [np.zeros(3), np.full(400, np.nan)])
def test_densities_of_another_shape_or_without_a_value_are_refused(wrong):
    class Wrong(LogNormal):
        def log_density(self, trials, values):
            return wrong

    with refused("log_density"):
        bg.fit(people(), Wrong(), strength="strength")


def test_trials_that_a_model_rules_out_are_said():
    class Late(LogNormal):
        def log_density(self, trials, values):
            density = super().log_density(trials, values)
            return np.where(trials.rt_s < 0.5, -np.inf, density)

    with pytest.warns(FitWarning, match="impossible under the fitted model"):
        fit = bg.fit(people(), Late(), strength="strength")
    assert np.isfinite(fit.optimum.log_likelihood)
