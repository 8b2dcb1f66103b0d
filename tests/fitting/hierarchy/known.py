"""People whose log likelihood is a known function of parameters on the scale."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from bgmodel.fitting.hierarchy.group import Scale


def wide(parameters=2, highest=1e9):
    """Return a scale whose ranges end at a height."""
    return Scale(np.zeros(parameters), np.full(parameters, highest), np.ones(parameters))


@dataclass
class Known:
    """A person with a log likelihood, as ``approximation.Person``."""

    function: Any
    scale: Scale

    def __call__(self, scaled):
        return self.function(scaled)
