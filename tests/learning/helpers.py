"""A Gaussian task that learning is tried on."""

import numpy as np

from bgmodel.simulated_evidence import separated_evidence

D, XI, T_MAX = 1.0, 25.0, 40
# In separated_evidence, two unit-variance channels: d of the ratio is sqrt 2 times theirs.
SEPARATION = D / np.sqrt(2)


def draw(rng):
    return lambda trials: separated_evidence(trials, T_MAX, SEPARATION, rng=rng)
