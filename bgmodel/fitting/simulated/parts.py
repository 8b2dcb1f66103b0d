"""Simulated trials in parts, which are left out in turn to estimate the simulation error."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Self

import numpy as np

from bgmodel.support.arrays import Truths

PARTS = 16
"""Parts of the simulated trials; trial k belongs to part ``k % PARTS``."""


class InParts(ABC):
    """A model of which some parts of the simulated trials can be used alone."""

    @abstractmethod
    def _part(self, parts: Truths) -> Self:
        """Return the model with the parts that are true, (PARTS,)."""

    def halves(self) -> tuple[Self, Self]:
        """Return the model with one half of its simulated trials, and with the other half."""
        even = np.arange(PARTS) % 2 == 0
        return self._part(even), self._part(~even)

    def left_out(self) -> tuple[Self, ...]:
        """Return the model without each part of its simulated trials in turn."""
        return tuple(self._part(~left) for left in np.eye(PARTS, dtype=np.bool_))
