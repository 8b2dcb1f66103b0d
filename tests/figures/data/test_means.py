"""Palmer's fit: the published monkeys, and data whose parameters are known."""

import numpy as np
import pytest

from bgmodel.fitting.algorithms import GapModel
from bgmodel.fitting.design import design_of
from bgmodel.fitting.person_fit import cells_of
from bgmodel.trials.reader import read_trials
from figures.data.means import fit_means
from tests.drawn import drawn

# Bound, sensitivity and t0 of Palmer's closed form, and the sd at 0 % coherence that it says.
MONKEYS = {"b": (0.638, 14.1, 0.379, 0.33), "n": (0.768, 12.5, 0.280, 0.48)}


@pytest.mark.parametrize("who", MONKEYS)
def test_the_monkeys_have_their_published_parameters(who):
    some = read_trials("roitman_shadlen_2002", strength="coherence", participant=who)
    design = design_of(some)
    fit = fit_means(design)
    per_share = fit.sensitivity * design.strength.max() / 0.512
    bound, sensitivity, t0_s, sd_s = MONKEYS[who]
    assert fit.bound == pytest.approx(bound, rel=0.03)
    assert per_share == pytest.approx(sensitivity, rel=0.03)
    assert fit.t0_s == pytest.approx(t0_s, rel=0.03)
    assert fit.sd_s[0] == pytest.approx(sd_s, rel=0.04)
    data = cells_of(design, np.ones((design.cells, 2, design.grid.bins)))
    assert fit.mean_s == pytest.approx(data["mean_s"].to_numpy(), abs=0.02)
    assert fit.accuracy[1:] == pytest.approx(data["accuracy"].to_numpy()[1:], abs=0.05)
    # A constant gap does not fit spreads: at 0 % the test's is far above the monkey's.
    assert fit.sd_s[0] > 1.4 * data["sd_s"][0]


def test_parameters_that_made_the_data_are_found():
    values = {"sensitivity": 12.0, "bound": 0.6}
    some = drawn(GapModel(), [0.0, 0.05, 0.15, 0.4], 2000, 41, lapse=0.001, **values)
    fit = fit_means(design_of(some))
    assert fit.sensitivity == pytest.approx(12, rel=0.05)
    assert fit.bound == pytest.approx(0.6, rel=0.03)
    assert fit.t0_s == pytest.approx(0.3, abs=0.01)
