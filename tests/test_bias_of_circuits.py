"""A bias of one channel's input, against the exact walk from a start that is not in the middle."""

from dataclasses import replace

import numpy as np
import pytest

from bgmodel.deciding.trace import Trace
from bgmodel.evidence import minus_log_softmax
from bgmodel.fitting.optimum import optimum
from bgmodel.fitting.responses import BIN_S, Grid
from bgmodel.fitting.settings import FitSettings
from bgmodel.fitting.simulated.circuit_model import CircuitModel
from bgmodel.fitting.simulated.crossings import log_odds
from bgmodel.integrators.first_passage import GaussianIncrements, walk
from circuits.anatomy import load_circuit
from tests.helpers import unwarned
from tests.test_start_point import RESPONSES, drawn

GRID = Grid(300)
THRESHOLD, ODDS = 0.25, float(log_odds(0.25))
IDEAL = load_circuit("bogacz_gurney", 2)


pytestmark = pytest.mark.usefixtures("brief_search")


class Integrator(CircuitModel):
    """A circuit without noise or delay, whose OUT is -ln P of the evidence and its bias."""

    def run(self, point, lowest_nats, bias=0.0):
        def made(read, first):
            time_ms = (np.arange(read.shape[1]) + 1) * 1000 * BIN_S
            return Trace(minus_log_softmax(self._drive(read, bias)), time_ms, step_ms=1000 * BIN_S)

        return made


@pytest.fixture(scope="module")
def model():
    return Integrator(IDEAL, noise_nats=2.0, trials=800, seed=31)


def decided(model, drift, bias, threshold=THRESHOLD, grid=GRID):
    """Return the probability of each response in each bin, (drifts, 2, bins)."""
    drift = np.atleast_1d(np.asarray(drift, float))
    settings = {"sensitivity": 1.0, "threshold_nats": threshold, "bias_nats": bias}
    values = {name: np.full(len(drift), value) for name, value in settings.items()}
    return model.decided(values, drift, grid)


def exact(drift, bias):
    """Return the share of response 1 and the mean time, s, of the walk that decides."""
    step = GaussianIncrements(2.0 * drift * BIN_S, 2.0 * np.sqrt(BIN_S))
    ends = walk(step, -ODDS - bias, ODDS - bias, t_max=300)
    mass = np.append(ends.steps_pmf[:-1], ends.steps_pmf[-1] - ends.p_forced)
    mean = mass @ np.arange(301) / mass.sum() * BIN_S
    return walk(step, -ODDS - bias, ODDS - bias).p_upper, mean


@pytest.mark.parametrize("bias", [0.3, 0.6, -0.6, 0.9])
@pytest.mark.parametrize("drift", [0.0, 1.5, -1.5, 4.0])
def test_an_ideal_circuit_with_a_bias_is_a_walk_from_another_start(model, drift, bias):
    density = decided(model, drift, bias)[0]
    ones, mean_s = exact(drift, bias)
    assert density[1].sum() / density.sum() == pytest.approx(ones, abs=0.012)
    time_s = (np.arange(GRID.bins) + 1) * BIN_S
    assert (density.sum(axis=0) @ time_s) / density.sum() == pytest.approx(mean_s, rel=0.03)
    # A negative control: the bias of the other sign would be seen.
    opposite = decided(model, drift, -bias)[0]
    assert abs(opposite[1].sum() / opposite.sum() - ones) > 0.03 or abs(drift) > 3


def test_a_bias_to_the_other_response_is_the_mirror_image(model):
    one, other = (decided(model, drift, bias)[0] for drift, bias in ((2.0, 0.5), (-2.0, -0.5)))
    np.testing.assert_array_equal(one, other[::-1])


def test_stored_biases_are_read_back(tmp_path, monkeypatch):
    small = {"noise_nats": 2.0, "trials": 32, "folder": tmp_path}
    first = decided(Integrator(IDEAL, **small), 1.0, 0.3)
    assert len([*tmp_path.glob("*.npz")]) == 7  # none, and 0.2 to 0.6 to either response
    monkeypatch.setattr(CircuitModel, "_simulate", None)
    again = decided(Integrator(IDEAL, **small), 1.0, 0.3)
    np.testing.assert_array_equal(again, first)


def test_the_start_of_a_test_is_found_as_the_bias_of_a_circuit():
    table = drawn(91_401, sensitivity=8.0, bound=0.7, start=0.25)
    asked = FitSettings(
        strength="coherence", free=("+bias_nats",),
        fix=tuple(f"{name}={RESPONSES[name]}" for name in ("t0_s", "t0_sd_s", "lapse")),
    )  # fmt: skip
    choices = asked.read(table)
    model = Integrator(IDEAL, noise_nats=2.0, trials=1000, seed=32, seconds=4.0)
    with unwarned():
        likelihood = asked.likelihood(asked.design(choices), model)
    best = optimum(likelihood)
    values = {name: float(np.atleast_1d(v)[0]) for name, v in best.values.items()}
    # The start is a share of the bound, and the bias of the log odds of the threshold.
    assert values["bias_nats"] / log_odds(values["threshold_nats"]) == pytest.approx(0.25, abs=0.05)
    without = replace(asked, free=())
    plain = optimum(without.likelihood(without.design(choices), model))
    assert best.log_likelihood > plain.log_likelihood + 50
