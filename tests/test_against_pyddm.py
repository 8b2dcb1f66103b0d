"""The log likelihood of trials with bias, drift variability and falling bounds, against PyDDM."""

import numpy as np
import pytest
from scipy.special import ndtr

from bgmodel.fitting.exact.algorithms import GapModel
from bgmodel.fitting.exact.gaps import EXPONENTIAL, WEIBULL
from bgmodel.fitting.exact.responses import BIN_S
from bgmodel.fitting.optimum import likelihood_of
from bgmodel.fitting.trials.design import design_of
from bgmodel.tables.choices import read_choices
from tests.test_start_point import RESPONSES, STRENGTHS, drawn

VALUES = {"sensitivity": 10.0, "bound": 0.9, "start": 0.25, "drift_sd": 1.0, "fall_per_s": 1.0}
SPACING = 0.5
"""Spacing of drifts, in standard deviations: the trapezoidal rule is exact to 1e-7."""
SECONDS = 4.0


def solved(gap, values, drift, step):
    """Return the densities of both decisions that PyDDM finds at one drift, (2, times), 1/s."""
    from pyddm import Bound, Model
    from pyddm.models import DriftConstant, ICPointRatio, NoiseConstant, OverlayNone

    class Falling(Bound):
        name = "bound of a gap"
        required_parameters = ()

        def get_bound(self, t, conditions, **_):
            return float(gap.at(values["bound"], values, np.array([t]))[0][0])

    made = Model(
        drift=DriftConstant(drift=drift), noise=NoiseConstant(noise=1), bound=Falling(),
        IC=ICPointRatio(x0=values["start"]), overlay=OverlayNone(),
        dx=step, dt=step, T_dur=SECONDS,
    ).solve()  # fmt: skip
    return np.stack([made.pdf("error"), made.pdf("correct")])


def of_pyddm(gap, values, step, latest_s):
    """Return the log likelihood of trials as a function of strengths, responses and times."""
    sd = values["drift_sd"]
    means = np.round(values["sensitivity"] * STRENGTHS / (SPACING * sd)).astype(int)
    near = np.arange(-12, 13)
    numbers = np.arange(means.min() - 12, means.max() + 13)
    at = dict(zip(numbers, [solved(gap, values, SPACING * sd * n, step) for n in numbers],
                  strict=True))  # fmt: skip
    weights = SPACING * np.exp(-((SPACING * near) ** 2) / 2) / np.sqrt(2 * np.pi)
    decided = {
        strength: sum(w * at[mean + n] for w, n in zip(weights, near, strict=True))
        for strength, mean in zip(STRENGTHS, means, strict=True)
    }

    def each(strength, response, rt_s):
        times = np.arange(decided[strength].shape[1]) * step
        left = (rt_s - RESPONSES["t0_s"] - times) / RESPONSES["t0_sd_s"]
        # The non-decision time is averaged over each step.
        half = step / 2 / RESPONSES["t0_sd_s"]
        kernel = ndtr(left + half) - ndtr(left - half)
        found = decided[strength][response] @ kernel
        return np.log((1 - RESPONSES["lapse"]) * found + RESPONSES["lapse"] / (2 * latest_s))

    return each


def compared(gap, seed, trials, step, **more):
    """Return log likelihoods per trial of one data set: ours, PyDDM's, and PyDDM's limit."""
    values = {**VALUES, **more}
    table = drawn(seed, trials, GapModel(gap), **values)
    design = design_of(read_choices(table, strength="coherence"), rt_window=(0, SECONDS),
                       sides=True)  # fmt: skip
    held = {name: value for name, value in {**values, **RESPONSES}.items() if name != "bound"}
    likelihood = likelihood_of(GapModel(gap), design, free=["bound"], fixed=held)
    latest_s = design.grid.bins * BIN_S
    coarse, fine = (of_pyddm(gap, values, s, latest_s) for s in (2 * step, step))
    rows = table[["coherence", "response", "rt"]].itertuples(index=False)
    pairs = np.array([[coarse(*row), fine(*row)] for row in rows])
    # Its error is of the first order in its step.
    return likelihood.each(np.array([values["bound"]])), pairs[:, 1], 2 * pairs[:, 1] - pairs[:, 0]


@pytest.mark.parametrize(("gap", "more"), [(EXPONENTIAL, {}), (WEIBULL, {"fall_shape": 3.0})])
def test_the_log_likelihood_is_that_of_pyddm(gap, more):
    """Within 0.5 nats of 2 000 trials, at a step that takes seconds."""
    pytest.importorskip("pyddm")
    own, fine, limit = compared(gap, 92_001, 400, 0.002, **more)
    assert own.sum() == pytest.approx(limit.sum(), abs=0.5)
    assert np.abs(own - limit).max() < 0.1
    # A difference would be seen: PyDDM's own step is worth more at half of this size.
    assert abs(own.sum() - fine.sum()) < 2.0


@pytest.mark.parametrize("name", ["drift_sd", "start", "fall_per_s"])
def test_another_value_of_a_parameter_is_told_by_its_likelihood(name):
    """A negative control: each parameter matters to these trials."""
    table = drawn(92_001, 400, GapModel(EXPONENTIAL), **VALUES)
    design = design_of(read_choices(table, strength="coherence"), rt_window=(0, SECONDS),
                       sides=True)  # fmt: skip

    def at(**values):
        held = {k: v for k, v in {**VALUES, **RESPONSES, **values}.items() if k != "bound"}
        found = likelihood_of(GapModel(EXPONENTIAL), design, free=["bound"], fixed=held)
        return found(np.array([VALUES["bound"]]))

    assert at(**{name: 0.8 * VALUES[name]}) < at() - 1.5
