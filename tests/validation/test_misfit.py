"""Clean sets are not said to be misfitted, and sets with fast guesses are: make validate."""

import warnings
from dataclasses import replace

import numpy as np
import pytest

from bgmodel.fitting.algorithms import GapModel
from bgmodel.fitting.design import design_of
from bgmodel.fitting.likelihood import likelihood_of
from bgmodel.fitting.misfit import misfit
from bgmodel.fitting.optimum import optimum
from tests.validation.test_slow_trials import simulated

pytestmark = pytest.mark.validate
SEED, SETS = 91_001, 200


def warned(number, guesses):
    """Return whether misfit is reported for a data set with some fast guesses."""
    some, _, _, rng = simulated(SEED, number)
    guess = rng.random(some.trials) < guesses
    rt_s = np.where(guess, rng.uniform(0.15, 0.3, some.trials), some.rt_s)
    response = np.where(guess, rng.integers(0, 2, some.trials), some.response)
    some = replace(some, rt_s=rt_s, response=response.astype(np.int8))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)
        best = optimum(likelihood_of(GapModel(), design_of(some)))
    return bool(misfit(best).cautions(best))


@pytest.mark.timeout(3600)
def test_clean_sets_are_hardly_ever_warned_of_and_fast_guesses_mostly():
    clean, fast = (sum(warned(k, share) for k in range(SETS)) for share in (0.0, 0.2))
    print(f"of {SETS} sets {clean} clean ones are warned of, and {fast} with 20 % of fast guesses")
    assert clean <= 0.02 * SETS
    assert fast >= 0.85 * SETS
