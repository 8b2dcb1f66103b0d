"""The MSPRT on Gaussian evidence drawn where it is decided: against exact walks and the trace."""

import numpy as np
import pytest
from scipy import stats

from bgmodel import Msprt, criterion_from_gap, stream, tally
from bgmodel.evidence import gaussian_evidence
from bgmodel.integrators.fused import (
    LANES,
    _exp,
    _log,
    _two_normals,
    fill_normals,
    gaussian_tally,
)
from bgmodel.theory.sprt import gaussian_pair, sprt, walk

SEED, TRIALS = 2025, 400_000
Z_LIMIT = 4.0


def z_of(seen, p, trials):
    """How many standard errors a count lies from its expectation."""
    return abs(seen - p * trials) / np.sqrt(trials * p * (1 - p))


def normals(keys):
    out = np.empty((2, LANES), np.float32)
    found = []
    for key in range(keys):
        fill_normals(out, np.uint64(key + 10**6))
        found.append(out.copy())
    return np.array(found, dtype=np.float64)


def test_exponential_and_logarithm_are_those_of_numpy_to_what_they_say():
    """Over all that they are given: differences of nats down to -80, and uniform numbers."""
    rng = np.random.default_rng(SEED)
    falls = np.concatenate([[0.0, -80.0], -rng.uniform(0, 80, 5000), -rng.uniform(0, 2, 5000)])
    falls = falls.astype(np.float32)
    found = np.array([_exp(x) for x in falls], dtype=np.float64)
    np.testing.assert_allclose(found, np.exp(falls.astype(np.float64)), rtol=1e-7)
    assert _exp(np.float32(-90.0)) == _exp(np.float32(-80.0))
    shares = np.concatenate([[2.0**-25, 1 - 2.0**-24], rng.uniform(0, 1, 5000)]).astype(np.float32)
    found = np.array([_log(u) for u in shares], dtype=np.float64)
    np.testing.assert_allclose(found, np.log(shares.astype(np.float64)), rtol=1e-7, atol=1e-7)


def test_the_noise_is_normal_and_white():
    found = normals(8_000)
    every = found.ravel()
    assert stats.kstest(every, "norm").pvalue > 1e-3
    n = every.size
    moments = [every.mean(), every.var() - 1, stats.skew(every), stats.kurtosis(every)]
    errors = np.sqrt(np.array([1, 2, 6, 24]) / n)
    assert (np.abs(moments) < Z_LIMIT * errors).all()
    for limit in (3.0, 4.0):
        p = 2 * stats.norm.sf(limit)
        assert z_of((np.abs(every) > limit).sum(), p, n) < Z_LIMIT
    # Pairs, neighbouring lanes and neighbouring keys share nothing, nor do their squares.
    for a, b in (
        (found[:, 0], found[:, 1]),
        (found[..., 1:], found[..., :-1]),
        (found[1:], found[:-1]),
    ):
        for power in (1, 2):
            r = np.corrcoef(a.ravel() ** power, b.ravel() ** power)[0, 1]
            assert abs(r) < Z_LIMIT / np.sqrt(a.size)


def test_two_words_are_two_normals_to_single_precision_at_every_turn():
    """Box & Muller in double precision, of the upper 24 bits of each word."""
    first, second = stream(SEED, "words").integers(0, 2**32, (2, 20_000), dtype=np.uint32)
    found = np.array([_two_normals(*words) for words in zip(first, second, strict=True)])
    u, turn = ((first >> 8) + 0.5) / 2**24, 2 * np.pi * (second >> 8) / 2**24
    radius = np.hypot(*found.T)
    # Near 1 single precision holds few values of u.
    assert (np.abs(radius - np.sqrt(-2 * np.log(u)))[u < 0.9]).max() < 1e-6
    off = found / radius[:, None] - np.stack([np.cos(turn), np.sin(turn)], axis=1)
    assert np.abs(off).max() < np.finfo(np.float32).eps


@pytest.mark.parametrize(("d", "t_max"), [(0.25, 50), (0.5, 30), (1.0, 9), (0.5, 1)])
def test_two_hypotheses_do_as_the_exact_walk(d, t_max):
    gaps = np.array([0.5, 2.0, 4.0, 8.0])
    found = gaussian_tally(TRIALS, t_max, d / np.sqrt(2), criterion_from_gap(gaps), seed=SEED)
    s1, s2 = gaussian_pair(d)
    exact = sprt(s1, s2, gaps, t_max=t_max)
    for k, gap in enumerate(gaps):
        ends = walk(s2, -gap / 2, gap / 2, t_max=t_max)
        at = np.arange(t_max + 1)
        sd = np.sqrt(ends.steps_pmf @ (at - ends.mean_steps) ** 2)
        assert z_of(found.correct[k], 1 - exact.error_rate[k], TRIALS) < Z_LIMIT
        assert abs(found.mean_steps[k] - exact.mean_steps[k]) <= Z_LIMIT * sd / np.sqrt(TRIALS)
        if 1e-4 < ends.p_forced < 1 - 1e-4:
            assert z_of(found.forced[k], ends.p_forced, TRIALS) < Z_LIMIT


@pytest.mark.parametrize("hypotheses", [3, 4, 8])
def test_more_hypotheses_do_as_the_test_on_evidence_that_is_kept(hypotheses):
    levels = -np.log(np.array([0.5, 0.7, 0.9, 0.97]))
    found = gaussian_tally(TRIALS, 20, 0.6, levels, seed=SEED, hypotheses=hypotheses)
    few = 40_000
    rng = stream(SEED, "fused", hypotheses)
    kept = gaussian_evidence(few, 20, 0.6, rng=rng, hypotheses=hypotheses)
    want = tally(Msprt().run(kept), kept.truth, levels)
    for seen, other in (
        (found.accuracy, want.accuracy),
        (found.forced / TRIALS, want.forced / few),
    ):
        error = np.sqrt(other * (1 - other) * (1 / few + 1 / TRIALS))
        assert (np.abs(seen - other) <= Z_LIMIT * np.maximum(error, 1e-4)).all()
    # A time is at most 20 readings, its sd at most 10.
    assert (np.abs(found.mean_steps - want.mean_steps) < Z_LIMIT * 7 / np.sqrt(few)).all()


def test_thresholds_are_counted_alike_alone_together_and_in_any_order():
    levels = -np.log(np.linspace(0.55, 0.99, 12))
    whole = gaussian_tally(3000, 40, 0.4, levels, seed=3)
    back = gaussian_tally(3000, 40, 0.4, levels[::-1], seed=3)
    for k in range(12):
        alone = gaussian_tally(3000, 40, 0.4, levels[k], seed=3)
        for name in ("correct", "steps", "forced"):
            assert getattr(alone, name)[0] == getattr(whole, name)[k] == getattr(back, name)[11 - k]


@pytest.mark.parametrize("hypotheses", [2, 5])
def test_a_trial_is_the_same_however_many_there_are(hypotheses):
    def correct(trials):
        one = gaussian_tally(trials, 12, 0.5, [0.2], seed=4, hypotheses=hypotheses)
        return [int(one.correct[0]), float(one.steps[0]), int(one.forced[0])]

    found = np.array([correct(n) for n in (1, 2, 127, 128, 129, 130, 400)])
    steps = np.diff(found, axis=0)
    # One trial more adds one choice, right or wrong, of 1 to 12 readings.
    for row in (0, 2, 3, 4):
        assert steps[row][0] in (0, 1)
        assert 1 <= steps[row][1] <= 12


def test_long_trials_do_not_overflow_the_counts():
    found = gaussian_tally(500, 32_000, 0.001, -np.log([0.9999]), seed=5)
    assert found.forced[0] == 500
    assert found.mean_steps[0] == 32_000
    few = gaussian_tally(9_000_000, 1, 3.0, [0.69], seed=6)
    assert few.accuracy[0] == pytest.approx(stats.norm.cdf(3 / np.sqrt(2)), abs=5e-4)


@pytest.mark.parametrize(
    ("changed", "says"),
    [
        ({"trials": 0}, "trials must be"),
        ({"steps": 40_000}, "steps must lie in 1..32767"),
        ({"separation": 0}, "separation must be > 0"),
        ({"thresholds": [0.8]}, "between 0 and ln 2 nats"),
        ({"thresholds": [[0.1]]}, "must be"),
        ({"hypotheses": 1}, "hypotheses must be"),
        ({"seed": -1}, "seed must be a whole number"),
        ({"seed": 1.5}, "seed must be a whole number"),
        ({"seed": 2**64}, "seed must be a whole number"),
    ],
)
def test_numbers_that_make_no_sense_are_refused(changed, says):
    given = {"trials": 10, "steps": 5, "separation": 0.5, "thresholds": [0.1], "seed": 1} | changed
    with pytest.raises(ValueError, match=says):
        gaussian_tally(**given)


def test_one_trial_of_one_reading_under_the_first_seed_is_a_tally():
    """The least of each number; at a posterior of all but 1 no reading is enough."""
    found = gaussian_tally(1, 1, 0.5, [1e-6, 0.69], seed=0)
    assert found.trials == 1
    assert found.steps.tolist() == [1, 1]
    assert found.forced[0] == 1
    assert set(found.correct.tolist()) <= {0, 1}
