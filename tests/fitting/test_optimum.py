"""The optimum on data whose parameters are known."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest

from bgmodel.fitting.algorithms import EXPONENTIAL, GapModel
from bgmodel.fitting.design import design_of
from bgmodel.fitting.likelihood import BinnedLikelihood, likelihood_of
from bgmodel.fitting.optimum import TOLERANCE_NATS, _scales, _slid, optimum
from bgmodel.fitting.parameters import Parameter, freedom
from bgmodel.fitting.posterior import directions
from bgmodel.fitting.responses import moments
from bgmodel.fitting.simulated.circuit_model import CircuitModel
from bgmodel.trials.reader import read_trials
from circuits.anatomy import load_circuit
from circuits.errors import FitWarning
from tests.drawn import TRUTH, drawn
from tests.helpers import unwarned

STRENGTHS = [0.0, 0.05, 0.15, 0.4]
CONSTANT, FALLING = GapModel(), GapModel(EXPONENTIAL)
CASES = {
    "constant": (CONSTANT, {"sensitivity": 12.0, "bound": 0.6}, 400),
    "falling": (FALLING, {"sensitivity": 12.0, "bound": 0.7, "fall_per_s": 1 / 0.3}, 500),
}


@pytest.mark.parametrize(
    ("case", "seed"), [("constant", 1), ("constant", 2), ("constant", 3), ("falling", 4)]
)
def test_parameters_that_made_the_data_are_found_within_their_errors(case, seed):
    model, values, trials = CASES[case]
    design = design_of(drawn(model, STRENGTHS, trials, seed, seconds=1.5, **values))
    held = {name: TRUTH[name] for name in ("t0_sd_s", "lapse")}
    likelihood = likelihood_of(model, design, fixed=held)
    truth = np.array([{**TRUTH, **values}[name] for name in likelihood.freedom.names])
    peak = optimum(likelihood)
    errors = directions(likelihood, truth).standard_errors
    assert (np.abs(peak.vector - truth) < 3 * errors).all()
    assert peak.log_likelihood >= likelihood(truth) - 0.01
    # Twice the gain is chi squared of as many degrees as there are parameters.
    assert peak.log_likelihood - likelihood(truth) < 12
    assert not peak.at_bound.any()
    assert likelihood(peak.vector) == pytest.approx(peak.log_likelihood, abs=1e-9)
    # They distinguish these from others: the errors are small relative to the values.
    assert (errors < 0.4 * truth).all()


@pytest.mark.parametrize("seed", [23, 26])
def test_a_falling_gap_is_never_less_likely_than_the_constant_gap_that_it_contains(seed):
    """Times of these sets are most likely under the constant gap."""
    values = {"sensitivity": 10.0, "bound": 0.45, "t0_s": 0.3}
    design = design_of(drawn(CONSTANT, [0.0, 0.1, 0.3], 60, seed, seconds=2.5, **values))
    free = ["sensitivity", "bound", "t0_s"]
    constant = optimum(likelihood_of(CONSTANT, design, free=free))
    falling = optimum(likelihood_of(FALLING, design, free=[*free, "fall_per_s"]))
    assert falling.log_likelihood >= constant.log_likelihood - 2 * TOLERANCE_NATS


@pytest.fixture(scope="module")
def small():
    return drawn(CONSTANT, [0.0, 0.1, 0.4], 150, 11, sensitivity=10.0, bound=0.6)


def test_the_log_likelihood_is_the_sum_over_trials_and_nothing_beyond_the_bounds(small):
    likelihood = likelihood_of(CONSTANT, design_of(small))
    start = likelihood.freedom.start
    assert likelihood(start) == pytest.approx(likelihood.each(start).sum())
    assert len(likelihood.each(start)) == small.trials
    for bound, step in ((likelihood.freedom.low, -1e-6), (likelihood.freedom.high, 1e-6)):
        beyond = start.copy()
        beyond[1] = bound[1] + step
        assert likelihood(beyond) == -np.inf


def within(usual, parameter):
    """Return a likelihood in which a parameter has another range and start."""
    every, names = usual.freedom.parameters, usual.freedom.names
    every = [parameter if each.name == parameter.name else each for each in every]
    return BinnedLikelihood(
        CONSTANT, usual.design, freedom(every, {}, usual.design.cells, free=names)
    )


def test_the_range_of_sensitivity_goes_by_the_largest_strength(small):
    freed = likelihood_of(CONSTANT, design_of(small)).freedom
    k = freed.names.index("sensitivity")
    assert [0.4 * each[k] for each in (freed.low, freed.high, freed.start)] == pytest.approx(
        [0.02, 18, 4]
    )


def test_a_search_begins_about_the_fastest_times_and_inside_where_a_start_is_a_bound(small):
    likelihood = likelihood_of(CONSTANT, design_of(small))
    (first,) = likelihood.starts()
    k = likelihood.freedom.names.index("t0_s")
    assert first[k] == pytest.approx(np.quantile(small.rt_s, 0.02) - 0.05)
    both = within(likelihood, Parameter("bound", 0.5, 0.9, 0.5)).starts()
    assert [start[1] for start in both] == pytest.approx([0.5, 0.7])
    assert both[0][2:] == pytest.approx(both[1][2:])


class Hills:
    """A log likelihood with a higher hill at 3 and a lower one at -3."""

    freedom = freedom([Parameter(name, -8.0, 8.0, 1.0) for name in "ab"], {}, 1)
    rough = True

    def height(self, vector):
        return self(vector)

    def __call__(self, vector):
        high, low = (-np.sum((vector - at) ** 2) for at in (3.0, -3.0))
        return float(max(high, low - 5))


def test_a_search_first_looks_as_far_away_as_about_a_sixth_of_its_start():
    """By 0.15 of it, but by no less than a fiftieth and no more than a fifth of the range."""
    first = np.array([4.0, -4.0])
    assert _scales(Hills(), first) == pytest.approx([0.6, 0.6])
    assert _scales(Hills(), np.array([0.0, 1.0])) == pytest.approx([0.32, 0.32])
    narrow = Hills()
    narrow.freedom = freedom([Parameter("a", 99.0, 101.0, 100.0)], {}, 1)
    assert _scales(narrow, np.array([100.0])) == pytest.approx([0.4])


@pytest.mark.parametrize("order", [1, -1])
def test_of_several_searches_the_best_one_counts(order):
    told = []
    starts = [np.full(2, at) for at in (3.2, -3.2)][::order]
    peak = optimum(Hills(), starts=starts, tell=lambda *each: told.append(each))
    assert peak.vector == pytest.approx([3, 3], abs=0.1)
    assert peak.log_likelihood == pytest.approx(0, abs=0.01)
    assert told[-1][0] == peak.evaluations
    # Sixteen points per generation.
    assert set(np.diff([0, *(done for done, _ in told)])) == {16}
    assert np.all(np.diff([best for _, best in told]) >= 0)


def test_responses_after_the_end_of_simulated_trials_are_said():
    """A circuit never decides then: at 0.5 s of 2, sensitivity and lapses would be wrong."""
    some = drawn(GapModel(), [0.05, 0.4], 80, 71, seconds=2.0, sensitivity=12.0, bound=0.6)
    later = int((some.rt_s > 0.5).sum())
    model = CircuitModel(load_circuit("bogacz_gurney", 2), "algebra", seconds=0.5, trials=16)
    with pytest.warns(FitWarning, match=f"all: {later} of 160 responses come after the 0.5 s"):
        likelihood_of(model, design_of(some))
    with unwarned():
        likelihood_of(replace(model, seconds=2.0), design_of(some))


def test_searches_in_threads_give_the_same_bytes_as_alone_and_leave_the_global_numbers(monkeypatch):
    # For this test alone: others of this file count the usual points.
    monkeypatch.setattr("bgmodel.fitting.optimum.POPULATION", 8)

    def searched(number):
        some = drawn(CONSTANT, [0.1, 0.4], 100, number, sensitivity=8.0, bound=0.5)
        return optimum(likelihood_of(CONSTANT, design_of(some))).vector.tobytes()

    alone = [searched(number) for number in range(2)]
    before = np.random.get_state()[1].tobytes()  # noqa: NPY002
    with ThreadPoolExecutor(2) as threads:
        assert list(threads.map(searched, range(2))) == alone
    assert np.random.get_state()[1].tobytes() == before  # noqa: NPY002


@pytest.mark.parametrize("longest", [0.8, 1.2, 4.0])
def test_predictions_do_not_depend_on_how_late_the_slowest_response_was(longest):
    """The mean time of a diffusion from the middle is ``bound / drift tanh(drift bound) + t0``."""
    times = np.append(np.random.default_rng(1).uniform(0.4, 0.8, 39), longest)
    table = pd.DataFrame({"rt": times, "response": (np.arange(40) % 4 > 0).astype(int)})
    values = {"sensitivity": 0.8, "bound": 0.7, "t0_s": 0.3, "t0_sd_s": 0.03}
    likelihood = likelihood_of(CONSTANT, design_of(read_trials(table)), fixed=values)
    wide = likelihood.complete(likelihood.freedom.low)
    mean_s = moments(wide.density(likelihood.freedom.low), wide.design.grid)["mean_s"][0]
    lapse = likelihood.freedom.low[0]
    end_s = likelihood.design.grid.bins * likelihood.design.grid.width_s
    expected = (1 - lapse) * (0.7 / 0.8 * np.tanh(0.8 * 0.7) + 0.3) + lapse * end_s / 2
    assert mean_s == pytest.approx(expected, abs=1e-3)
    both = [one.density(likelihood.freedom.low) for one in (likelihood, wide)]
    np.testing.assert_array_equal(both[1][:, :, : both[0].shape[2]], both[0])


def test_with_a_deadline_predictions_end_there():
    design = design_of(drawn(CONSTANT, STRENGTHS, 60, 1, deadline_s=0.9, **CASES["constant"][1]))
    likelihood = likelihood_of(CONSTANT, design)
    assert likelihood.complete(likelihood.starts()[0]) is likelihood


class Scored:
    """A likelihood of three numbers that is searched along its scores."""

    scored, rough = True, False
    freedom = SimpleNamespace(
        low=np.full(3, -100.0), high=np.full(3, 100.0), to_scale=np.asarray,
        from_scale=np.asarray, scale_rate=np.ones_like, log_prior=lambda v: 0.0,
        prior_slope=lambda v: (np.zeros(3), np.zeros(3)),
    )  # fmt: skip

    def scores(self, vector):
        return self.with_scores(vector)[1]

    def __call__(self, vector):
        return float(self.with_scores(vector)[0].sum())


@pytest.mark.parametrize("third", [0.0, 1.0])
def test_a_search_along_scores_finds_least_squares_where_only_a_sum_of_numbers_is_known(third):
    """Of two proportional columns only one sum of coefficients follows from the data."""
    rng = np.random.default_rng(2)
    x = rng.standard_normal((3000, 3))
    x[:, 2] = 2 * x[:, 1] + third * x[:, 2]
    y = x @ [1.0, -0.5, 0.25] + rng.standard_normal(3000)

    class Line(Scored):
        def with_scores(self, vector):
            off = y - x @ vector
            return -(off**2) / 2, off[:, None] * x

    best, height, _ = _slid(Line(), np.zeros(3))
    least, *_ = np.linalg.lstsq(x, y, rcond=None)
    assert height == pytest.approx(-((y - x @ least) ** 2).sum() / 2, abs=1e-3)
    assert x @ best == pytest.approx(x @ least, abs=1e-3)


@pytest.mark.parametrize("order", [1, -1])
def test_of_several_starts_a_search_along_scores_keeps_the_best(order):
    """Each number has a lower peak near -1 and a higher one near 1."""

    class Peaks(Scored):
        def with_scores(self, vector):
            each = -((vector**2 - 1) ** 2) + 0.2 * vector
            return each, np.diag(-4 * vector * (vector**2 - 1) + 0.2)

    starts = [np.full(3, 0.8), np.full(3, -0.8)][::order]
    best = optimum(Peaks(), starts=starts)
    assert best.vector == pytest.approx(np.full(3, 1.0), abs=0.1)
    alone = optimum(Peaks(), starts=[np.full(3, -0.8)])
    assert alone.vector == pytest.approx(np.full(3, -1.0), abs=0.1)
    assert best.log_likelihood > alone.log_likelihood + 1
