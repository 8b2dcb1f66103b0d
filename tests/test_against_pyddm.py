"""The log likelihood of trials with bias, drift variability and falling bounds, against PyDDM."""

import numpy as np
import pytest

from bgmodel.fitting.exact.algorithms import EXPONENTIAL, WEIBULL, GapModel
from bgmodel.fitting.exact.responses import BIN_S
from bgmodel.fitting.likelihood import likelihood_of
from bgmodel.fitting.trials.design import design_of
from bgmodel.trials.reading import read_trials
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


@pytest.mark.parametrize(("gap", "more"), [(EXPONENTIAL, {}), (WEIBULL, {"fall_shape": 3.0})])
def test_the_log_likelihood_is_that_of_pyddm(gap, more):
    """Within 0.5 nats of 2 000 trials, at a step that takes seconds."""
    pytest.importorskip("pyddm")
    ours, fine, limit = compared(gap, 92_001, 400, 0.002, **more)
    assert ours.sum() == pytest.approx(limit.sum(), abs=0.5)
    assert np.abs(ours - limit).max() < 0.1
    # A difference would be seen: PyDDM's own step is worth more at half of this size.
    assert abs(ours.sum() - fine.sum()) < 2.0
