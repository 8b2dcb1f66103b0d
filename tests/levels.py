"""A circuit whose dopamine is set, and made-up outcomes of its levels."""

import numpy as np

from bgmodel.integrators.basal_ganglia import BasalGanglia
from bgmodel.learning.dopamine import playable_levels
from bgmodel.learning.reinforce import LevelOutcomes
from bgmodel.support.seeds import stream
from circuits.anatomy import load_circuit
from circuits.engines import Rates

XI, SEED, GAIN = 50.0, 61, 0.5
PLAYED = (0.75, 2.0)
MODEL = BasalGanglia(load_circuit("spiking_msprt"), Rates(dt_ms=0.5), GAIN)
LEVELS = playable_levels(MODEL, 9)


def synthetic(trials=4000, best=1.2):
    """Return outcomes with mean reward -10 (level - best)^2 - 5 and noise."""
    levels = np.linspace(*PLAYED, 26)
    noise = stream(SEED, "noise").normal(0, 1, (1, trials))
    steps = 10 * (levels[:, None] - best) ** 2 + 5 + noise
    return LevelOutcomes(levels, np.ones((26, trials), bool), steps, np.zeros(26))
