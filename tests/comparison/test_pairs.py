"""Decision against decision: its chance level against all pairs written out, and its laws."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bgmodel import stream
from bgmodel.comparison.pairs import NearInTime, Product, SameChoice, by_chance, side_by_side
from bgmodel.deciding.tradeoff import ChoicesAndTimes


@given(st.integers(0, 2**31), st.integers(3, 14))
def test_chance_is_the_mean_over_all_pairs_of_different_trials_of_one_truth(seed, trials):
    rng = np.random.default_rng(seed)
    truth = rng.integers(2, size=trials)
    x, y = rng.integers(0, 3, (2, trials))
    test_ms, other_ms = rng.integers(0, 10, (2, trials)) * 25.0
    first, second = rng.integers(0, 3, (2, 2, trials)).astype(float)
    near = np.abs(other_ms[None, :] - test_ms[:, None] - 30) <= 50
    for of_pair, written in (
        (SameChoice(x, y), x[:, None] == y[None, :]),
        (NearInTime(test_ms, other_ms, 30.0), near),
        (Product(test_ms, other_ms), test_ms[:, None] * other_ms[None, :]),
    ):
        chance = by_chance(of_pair, truth, first, second)
        for b in range(2):
            total = counted = 0.0
            for s in (0, 1):
                here = truth == s
                pairs = np.outer(first[b][here], second[b][here])
                np.fill_diagonal(pairs, 0)
                if pairs.sum():
                    weight = first[b][here].sum()
                    total += weight * (pairs * written[np.ix_(here, here)]).sum() / pairs.sum()
                    counted += weight
            wanted = total / counted if counted else np.nan
            np.testing.assert_allclose(chance[b], wanted, rtol=1e-9, atol=1e-9)


def test_without_a_truth_all_trials_are_shuffled():
    """Two alternatives, each chosen in half of the trials: agreement by chance is a half."""
    choice = np.arange(2000) % 2
    one = ChoicesAndTimes(choice, np.arange(2000.0))
    unknown = side_by_side(one, one, None, np.ones((1, 2000)))
    assert unknown["agreement_chance"][0] == pytest.approx(0.5, abs=1e-3)
    known = side_by_side(one, one, choice, np.ones((1, 2000)))
    assert known["agreement_chance"][0] == 1
    assert np.isnan(known["agreement_corrected"][0])


def test_r_by_its_ceiling_is_that_without_noise():
    """Spearman 1904: noise of variance v lowers r by sqrt(1 / (1 + v)), which its copy tells."""
    rng = stream(4, "attenuation")
    exact = rng.normal(0, 1, 20_000)
    noisy, again = exact + rng.normal(0, 0.7, (2, 20_000))
    choice = np.zeros(20_000, dtype=int)
    one, two, three = (ChoicesAndTimes(choice, values) for values in (exact, noisy, again))
    measures = side_by_side(one, two, None, np.ones((1, 20_000)), again=three)
    assert measures["pearson_r"][0] == pytest.approx(np.sqrt(1 / 1.49), abs=0.01)
    assert measures["r_noise_corrected"][0] == pytest.approx(1, abs=0.01)


def test_accuracies_and_times_are_counted_with_the_weights_of_trials():
    truth = np.array([0, 1, 1, 0])
    test = ChoicesAndTimes(np.array([0, 1, 0, 1]), np.array([10.0, 20, 30, 60]))
    other = ChoicesAndTimes(np.array([0, 1, 1, 1]), np.array([15.0, 25, 35, 75]))
    weights = np.array([[1.0, 1, 1, 1], [3, 0, 0, 1]])
    measures = side_by_side(test, other, truth, weights)
    assert measures["test_accuracy"].tolist() == [0.5, 0.75]
    assert measures["accuracy"].tolist() == [0.75, 0.75]
    assert measures["agreement"].tolist() == [0.75, 1]
    assert measures["error_agreement"].tolist() == [0.5, 1]
    assert measures["test_ms"].tolist() == [30, 22.5]
    # Lags of 5, 5, 5 and 15: about the median one is 10 late.
    assert measures["residual_sd_ms"] == pytest.approx([10 * np.sqrt(3 / 16)] * 2)
