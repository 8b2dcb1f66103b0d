"""The exact density of spikes and choices: closed forms, paths of the noise, derivatives."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.special import ndtr
from scipy.stats import norm, poisson

from bgmodel.fitting.cells import density
from bgmodel.fitting.cells.density import chosen, moved, noise_grid, p_right, passed
from bgmodel.fitting.cells.encoding import ENCODINGS, encoding_of
from bgmodel.fitting.cells.model import SHARED
from bgmodel.fitting.cells.sessions import BIN_S, KNOTS, RecordedSession, courses

TWO = {each.name: each.start for each in SHARED}


def one_sum(values):
    """Return parameters with which the sum that decides is that of the cells."""
    of_sum = ("noise", "start_noise", "leak_per_s")
    return values | {f"deciding_{name}": values[name] for name in of_sum} | {"shared_noise": 1.0}


DEFAULT = one_sum(TWO)


def session(trials=6, bins=8, cells=2, seed=3):
    """Return a session with random clicks, spikes and choices."""
    rng = np.random.default_rng(seed)
    end_s = rng.uniform(0.5, 1.0, trials) * bins * BIN_S
    click_s = np.sort(rng.uniform(0, bins * BIN_S, (trials, 10)), axis=1)
    click_s[click_s > end_s[:, None]] = np.inf
    made = RecordedSession(
        np.arange(trials), tuple(map(str, range(cells))), end_s, rng.integers(0, 2, trials),
        click_s, rng.choice([-1.0, 1.0], (trials, 10)),
        rng.poisson(0.6, (cells, trials, bins)).astype(float),
        rng.normal(0, 0.5, (cells, trials, bins)), courses(bins),
    )  # fmt: skip
    made.counts[:] *= made.on
    return made


def numbers(count, gain, seed=5):
    rng = np.random.default_rng(seed)
    course = rng.normal(2.5, 0.3, (count, KNOTS))
    return [np.r_[each, 0.4, gain * (1 + k)] for k, each in enumerate(course)]


def poisson_log(data, cells, encoding, sums):
    """Return the log probability of all spikes given the sum of clicks, (trials,)."""
    log_p = np.zeros(len(data.end_s))
    for count, past, cell in zip(data.counts, data.past, cells, strict=True):
        base = data.basis @ cell[:KNOTS] + cell[-2] * past
        _, rate, _ = encoding.rate(base, cell[-1] * encoding.encode(sums)[0])
        # Counts over their factorials, which no parameter moves, are left out.
        log = count * np.log(rate * BIN_S) - rate * BIN_S
        log_p += (log * data.on).sum(axis=1)
    return log_p


@pytest.mark.parametrize("name", ENCODINGS)
def test_without_noise_it_is_a_poisson_regression_and_a_probit_of_the_clicks(name):
    data, encoding = session(), ENCODINGS[name]
    values = one_sum(TWO | {"noise": 1e-4, "start_noise": 1e-4, "choice_noise": 1.5})
    cells = numbers(2, 0.1)
    sums = data.sums(values["leak_per_s"], values["adaptation"], values["recovery_s"])
    right = 0.95 * ndtr((sums[:, -1] + values["bias"]) / 1.5) + 0.025
    choice = np.log(np.where(data.choice == 1, right, 1 - right))
    exact = poisson_log(data, cells, encoding, sums[:, :-1]) + choice
    assert np.allclose(passed(data, values, cells, encoding).log_density, exact, atol=1e-4)


@pytest.mark.parametrize("leak", [-1.0, 0.0, 3.0])
def test_without_gain_spikes_and_choice_are_independent(leak):
    data, encoding = session(), ENCODINGS["exponential"]
    values, cells = TWO | {"leak_per_s": leak, "noise": 3.0}, numbers(2, 0.0)
    right = p_right(data, values)
    spikes = poisson_log(data, cells, encoding, np.zeros(data.on.shape))
    exact = spikes + np.log(np.where(data.choice == 1, right, 1 - right))
    assert np.allclose(passed(data, values, cells, encoding).log_density, exact, atol=1e-5)


def test_one_bin_is_an_integral_over_two_gaussians():
    data = session(bins=1)
    data.end_s[:] = np.linspace(BIN_S, 1.9 * BIN_S, len(data.end_s))
    encoding, values, cells = ENCODINGS["linear"], DEFAULT, numbers(2, 0.08)
    sums = data.sums(values["leak_per_s"], values["adaptation"], values["recovery_s"])
    left, added = moved(values["leak_per_s"], values["noise"], BIN_S / 2)
    n = np.linspace(-20, 20, 4001)
    density = norm.pdf(n, scale=np.sqrt(left**2 * values["start_noise"] ** 2 + added))
    rest = np.maximum(data.end_s - BIN_S / 2, 0)
    left, added = moved(values["leak_per_s"], values["noise"], rest)
    for k in range(len(data.end_s)):
        sd = np.sqrt(added[k] + values["choice_noise"] ** 2)
        right = 0.95 * ndtr((left[k] * n + sums[k, 1] + values["bias"]) / sd) + 0.025
        each = density * (right if data.choice[k] else 1 - right)
        for count, past, cell in zip(data.counts, data.past, cells, strict=True):
            base = data.basis[0] @ cell[:KNOTS] + cell[-2] * past[k, 0]
            _, rate, _ = encoding.rate(base, cell[-1] * (sums[k, 0] + n))
            # Without the factorial, as above.
            each *= poisson.pmf(0, rate * BIN_S) * (rate * BIN_S) ** count[k, 0]
        exact = np.log(np.trapezoid(each, n))
        assert passed(data, values, cells, encoding).log_density[k] == pytest.approx(
            exact, abs=1e-5
        )


def test_choices_alone_are_those_of_the_closed_form():
    data = session(bins=12, cells=0)
    right = p_right(data, DEFAULT)
    exact = np.log(np.where(data.choice == 1, right, 1 - right))
    assert np.allclose(passed(data, DEFAULT, [], ENCODINGS["linear"]).log_density, exact, atol=1e-6)
    data.choice[:] = -1
    assert np.allclose(passed(data, DEFAULT, [], ENCODINGS["linear"]).log_density, 0, atol=1e-9)


def test_without_shared_noise_the_choice_is_that_of_the_deciding_sum_alone():
    data, encoding, cells = session(), ENCODINGS["exponential"], numbers(2, 0.1)
    values = TWO | {"shared_noise": 0.0}
    silent = replace(data, choice=np.full(6, -1))
    spikes = passed(silent, values, cells, encoding).log_density
    choice = np.log(chosen(p_right(data, values), data))
    assert np.allclose(
        passed(data, values, cells, encoding).log_density, spikes + choice, atol=1e-9
    )


def test_the_mean_over_simulated_paths_of_the_noise_converges_to_it():
    data, encoding, cells = session(trials=3), ENCODINGS["exponential"], numbers(2, 0.1)
    values = TWO | {"noise": 3.0, "deciding_leak_per_s": -1.0, "shared_noise": 0.7}
    rng, runs = np.random.default_rng(8), 40_000
    sums = data.sums(values["leak_per_s"], values["adaptation"], values["recovery_s"])
    exact = passed(data, values, cells, encoding).log_density
    for k in range(3):
        n, before = values["start_noise"] * rng.standard_normal(runs), 0.0
        log = np.zeros(runs)
        for b, at in enumerate([*data.middles_s[: data.bins[k]], data.end_s[k]]):
            left, added = moved(values["leak_per_s"], values["noise"], at - before)
            n, before = left * n + np.sqrt(added) * rng.standard_normal(runs), at
            if b == data.bins[k]:
                break
            for count, past, cell in zip(data.counts, data.past, cells, strict=True):
                base = data.basis[b] @ cell[:KNOTS] + cell[-2] * past[k, b]
                rate = encoding.rate(base, cell[-1] * (sums[k, b] + n))[1] * BIN_S
                log += count[k, b] * np.log(rate) - rate
        sd, deciding_sd = (
            np.sqrt(left**2 * start**2 + added)
            for start, (left, added) in (
                (values["start_noise"], moved(values["leak_per_s"], 3.0, data.end_s[k])),
                (0.02, moved(-1.0, values["deciding_noise"], data.end_s[k])),
            )
        )
        x = data.sums(-1.0, values["adaptation"], values["recovery_s"])[k, -1] + values["bias"]
        x = x + deciding_sd * (0.7 * n / sd + np.sqrt(1 - 0.7**2) * rng.standard_normal(runs))
        right = ndtr(x / values["choice_noise"])
        right = 0.95 * right + 0.025
        weight = np.exp(log - log.max()) * (right if data.choice[k] else 1 - right)
        error = weight.std() / weight.mean() / np.sqrt(runs)
        assert abs(np.log(weight.mean()) + log.max() - exact[k]) < 4 * error


@pytest.mark.parametrize("name", [*ENCODINGS, "macaque D2"])
def test_derivatives_are_those_of_the_density(name):
    data, encoding = session(), encoding_of(name)
    cells = numbers(2, 0.1)
    values = TWO | {"noise": 3.0, "choice_noise": 1.0, "shared_noise": 0.8, "nats_per_click": 0.7}
    done = passed(data, values, cells, encoding, [*values])

    def density(values, cells):
        return passed(data, values, cells, encoding).log_density

    for parameter, step in ((each, 1e-4) for each in values):
        above, below = (values | {parameter: values[parameter] + x} for x in (step, -step))
        apart = (density(above, cells) - density(below, cells)) / (2 * step)
        assert np.allclose(done.shared[parameter], apart, atol=2e-3), parameter
    for k in (0, KNOTS, KNOTS + 1):
        away = np.eye(KNOTS + 2)[k] * 1e-5
        above, below = ([cells[0] + x, cells[1]] for x in (away, -away))
        apart = (density(values, above) - density(values, below)) / 2e-5
        assert np.allclose(done.cells[0][:, k], apart, atol=1e-4)


def test_a_grid_resolves_steps_that_are_small_beside_the_noise_at_the_onset():
    data, values = session(), DEFAULT | {"noise": 1.0, "start_noise": 6.0}
    n = noise_grid(data, values)
    step = np.sqrt(moved(values["leak_per_s"], values["noise"], BIN_S)[1])
    assert n[1] - n[0] < 1.3 * step or len(n) == 160


def test_noise_at_the_onset_alone_is_one_integral_on_a_fine_grid(monkeypatch):
    monkeypatch.setattr(density, "MOST", 1600)  # later steps are as wide as the grid resolves
    data, encoding, cells = session(), ENCODINGS["exponential"], numbers(2, 0.1)
    values = one_sum(TWO | {"noise": 1e-6, "start_noise": 1.0, "leak_per_s": 1.0})
    sums = data.sums(values["leak_per_s"], values["adaptation"], values["recovery_s"])
    onset, each = np.linspace(-6, 6, 241), []
    for n in onset:
        spikes = poisson_log(data, cells, encoding, sums[:, :-1] + n * np.exp(-data.middles_s))
        mean = sums[:, -1] + n * np.exp(-data.end_s) + values["bias"]
        right = 0.95 * ndtr(mean / values["choice_noise"]) + 0.025
        each.append(norm.pdf(n) * np.exp(spikes) * np.where(data.choice == 1, right, 1 - right))
    exact = np.log(np.trapezoid(each, onset, axis=0))
    assert np.allclose(passed(data, values, cells, encoding).log_density, exact, atol=5e-4)
