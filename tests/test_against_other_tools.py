"""Likelihoods and simulated decisions against PyDDM, ssm-simulators and NumPyro."""

import numpy as np
import pytest

from bgmodel import stream
from bgmodel.deciding.decision import first_crossing
from bgmodel.fitting.algorithms import EXPONENTIAL, HYPERBOLIC, WEIBULL, GapModel
from bgmodel.fitting.design import design_of
from bgmodel.fitting.hierarchy.approximation import Person, estimates
from bgmodel.fitting.hierarchy.group import Scale
from bgmodel.fitting.likelihood import likelihood_of
from bgmodel.fitting.responses import BIN_S
from bgmodel.trials.reader import read_trials
from figures.tools import measure_crosschecks as crosschecks
from figures.tools import measure_samplers, other_tools
from figures.tools.other_tools import Accumulators
from figures.tools.pyddm_gaps import ByPyddm
from tests.test_start_point import RESPONSES, drawn

VALUES = {"sensitivity": 10.0, "bound": 0.9, "start": 0.25, "drift_sd": 1.0, "fall_per_s": 1.0}
SECONDS = 4.0


def compared(gap, seed, trials, step, **more):
    """Return log likelihoods per trial of one data set: ours, PyDDM's, and PyDDM's limit."""
    values = {**VALUES, **more}
    table = drawn(seed, trials, GapModel(gap), **values)
    design = design_of(read_trials(table, strength="coherence"), rt_window=(0, SECONDS),
                       sides=True)  # fmt: skip
    held = {name: value for name, value in {**values, **RESPONSES}.items() if name != "bound"}
    likelihood = likelihood_of(GapModel(gap), design, free=["bound"], fixed=held)
    columns = (table[name].to_numpy() for name in ("coherence", "response", "rt"))
    trials = dict(zip(("strength", "response", "rt_s"), columns, strict=True))
    coarse, fine = (
        ByPyddm(gap, one, design.grid.bins * BIN_S, **trials).each({**values, **RESPONSES})
        for one in (2 * step, step)
    )
    # Its error is of the first order in its step.
    return likelihood.each(np.array([values["bound"]])), fine, 2 * fine - coarse


FINE = 92_002, 1000, 0.0005


@pytest.mark.parametrize(
    ("gap", "more", "size"),
    [
        (EXPONENTIAL, {}, (92_001, 400, 0.002)),
        (WEIBULL, {"fall_shape": 3.0}, (92_001, 400, 0.002)),
        *(pytest.param(gap, more, FINE, marks=pytest.mark.validate)
          for gap, more in ((EXPONENTIAL, {}), (HYPERBOLIC, {}), (WEIBULL, {"fall_shape": 3.0}))),
    ],
)  # fmt: skip
def test_the_log_likelihood_is_that_of_pyddm(gap, more, size):
    """Within 0.5 nats of 2 000 trials, at a step that takes seconds; of more on a fine grid."""
    pytest.importorskip("pyddm")
    ours, fine, limit = compared(gap, *size, **more)
    assert ours.sum() == pytest.approx(limit.sum(), abs=0.5)
    if size == FINE:
        return
    assert np.abs(ours - limit).max() < 0.1
    # A difference would be seen: PyDDM's own step is worth more at half of this size.
    assert abs(ours.sum() - fine.sum()) < 2.0


D = 0.05
POINT = Accumulators(3, 0.3, 6.0, 0.1, 0.05)


@pytest.mark.parametrize(("theta", "share"), [(0.5, 0.0), (1.0, 0.4), (2.0, 0.0)])
def test_the_exact_walk_is_the_diffusion_of_pyddm_with_bounds_moved_out(theta, share):
    pytest.importorskip("pyddm")
    at = D, theta, share * theta
    walk, diffusion = other_tools.exact(*at), other_tools.by_pyddm(*at)
    assert diffusion.error_rate == pytest.approx(walk.error_rate, abs=1e-4)
    assert diffusion.mean == pytest.approx(walk.mean, rel=1e-3)
    # At whole readings, where both say what has been decided.
    apart = np.abs(diffusion.before(walk.readings) - walk.cdf).max()
    assert apart < 3e-4
    for wrong in ({"overshoot": 0.0}, {"drift": crosschecks.WRONG}):
        control = other_tools.by_pyddm(*at, **wrong)
        moved = np.abs(control.before(walk.readings) - walk.cdf).max()
        assert moved > 4 * apart or abs(control.error_rate - walk.error_rate) > 2e-3


def test_simulated_decisions_are_those_of_both_solutions_and_of_no_control():
    pytest.importorskip("pyddm")
    at, trials = (D, 0.5, 0.0), 8000
    correct, readings = crosschecks.decided(*at, trials, "test")
    times = crosschecks.spread(readings, "test")
    for solution in (other_tools.exact, other_tools.by_pyddm):
        check = crosschecks.held(correct, readings, solution(*at), times)
        assert abs(check["z_error"]) < 3.5
        assert abs(check["z_mean"]) < 3.5
        assert check["p"] > 1e-3
    raw = other_tools.by_pyddm(*at, overshoot=0.0)
    assert crosschecks.held(correct, readings, raw, times)["p"] < 1e-3


@pytest.mark.parametrize("point", [Accumulators(3, 0.3, 6.0), POINT], ids=["race", "LCA"])
def test_moved_up_and_with_steps_of_a_reading_their_accumulators_are_ours(point):
    """The same noise by hand: theirs summed over a time step, ours with the evidence held."""
    evidence = point.evidence(3, stream(2, "accumulators"))
    integrator, threshold = point.ours()
    out = -integrator.run(evidence).out_nats
    added = stream(2, "accumulators").standard_normal((3, other_tools.SSM_READINGS, 3))
    added[:, :, 0] += point.separation
    _, settings = point.theirs()
    g, b, floor = settings.get("g", 0.0), settings.get("b", 0.0), other_tools.FLOOR
    v = np.array([settings[f"v{i}"] for i in range(3)]) - [point.separation, 0, 0]
    x = np.full((3, 3), floor)
    for k in range(200):
        x = x + v - (g - b) * x - b * x.sum(axis=1, keepdims=True) + added[:, k]
        assert x - floor == pytest.approx(out[:, k + 1], abs=1e-8)
    assert settings["a"] * settings["z0"] == pytest.approx(floor)
    assert settings["a"] - floor == pytest.approx(-threshold)


@pytest.mark.parametrize("point", [Accumulators(2, 0.3, 6.0), POINT], ids=["race", "LCA"])
def test_ssm_simulators_decides_as_we_do(point):
    pytest.importorskip("ssms")
    from scipy.stats import ks_2samp

    trials = 3000
    integrator, threshold = point.ours()
    evidence = point.evidence(trials, stream(3, "accumulators"))
    crossing = first_crossing(integrator.run(evidence), threshold)
    right = crossing.choice == 0
    theirs = other_tools.by_ssm_simulators(*point.theirs(), trials, 5)
    error = np.hypot(right.std(), theirs.correct.std()) / np.sqrt(trials)
    assert abs(right.mean() - theirs.correct.mean()) < 3.5 * error
    assert ks_2samp(crossing.steps, theirs.readings).pvalue > 1e-3
    at_floor = other_tools.by_ssm_simulators(*point.theirs(floor=0.0), trials, 5)
    assert ks_2samp(crossing.steps, at_floor.readings).pvalue < 1e-6


def test_the_density_that_nuts_has_is_that_of_our_fit():
    """Up to the bins of time, near the parameters that made the trials."""
    pytest.importorskip("numpyro").enable_x64()
    people = measure_samplers.likelihoods(40)
    scale = Scale.of(next(iter(people.values())).freedom)
    logs = measure_samplers.log_likelihood(people, scale)
    best = scale.to(estimates(list(people.values()), 1))
    for scaled in best + np.random.default_rng(3).normal(0, 0.1, (6, *best.shape)):
        ours = [Person(one, scale)(x) for one, x in zip(people.values(), scaled, strict=True)]
        np.testing.assert_allclose(logs(scaled), ours, atol=1.0)
        assert float(np.sum(logs(scaled))) == pytest.approx(sum(ours), abs=1.5)
