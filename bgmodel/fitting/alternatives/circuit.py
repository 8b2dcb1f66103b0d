"""A circuit of N channels as a model of choices between N alternatives."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Any

import numpy as np

from bgmodel.fitting.alternatives.crossings import DRIFTS, ManyCrossings, simulated_many
from bgmodel.fitting.exact.algorithms import SENSITIVITY
from bgmodel.fitting.exact.responses import Grid
from bgmodel.fitting.parameters import Parameter
from bgmodel.fitting.simulated.circuit import LEVELS, LOWEST_LOG_ODDS, THRESHOLD, CircuitModel
from bgmodel.fitting.simulated.crossings import interpolated, log_odds
from bgmodel.support.arrays import Array
from bgmodel.tables.alternatives import MOST
from circuits.errors import require


@dataclass(frozen=True)
class ManyCircuitModel(CircuitModel):
    """A circuit of three or more channels; parameters as for ``CircuitModel``.

    All channels but that of the correct alternative receive the same evidence. Thresholds begin
    just above the log odds of the prior.
    """

    def _check_channels(self) -> None:
        """Raise ValueError unless the circuit has three to twelve channels."""
        channels = self.circuit.channels
        require(3 <= channels <= MOST, "circuit", f"must have 3 to {MOST} channels", channels)

    @property
    def _more(self) -> tuple[Parameter, ...]:
        """None: mechanisms and biases are those of two channels."""
        return ()

    @property
    def lowest_log_odds(self) -> float:
        """Log odds of the highest threshold."""
        return LOWEST_LOG_ODDS - float(np.log(self.circuit.channels - 1))

    def identity(self) -> dict[str, object]:
        """Return all that its predictions depend on."""
        thresholds = self.thresholds_nats[[0, -1]].tolist()
        channels = {"alternatives": self.circuit.channels, "drifts": list(DRIFTS)}
        return {**super().identity(), **channels, "thresholds": [LEVELS, *thresholds]}

    def decided(self, values: Mapping[str, Array], strength: Array, grid: Grid) -> Array:
        """Return the probability of a wrong and of a correct decision; see ``algorithms.Model``."""
        drift = values[SENSITIVITY.name] * strength
        odds, levels = log_odds(values[THRESHOLD]), log_odds(self.thresholds_nats[::-1])
        places = LEVELS - 1 - np.interp(odds, levels, np.arange(LEVELS))
        probability = np.zeros((len(strength), 2, grid.bins))
        for cell, (place, v) in enumerate(zip(places, drift, strict=True)):
            mass = self._crossings.decided(interpolated(float(place), LEVELS), float(v))
            few = min(grid.bins, mass.shape[1])
            probability[cell, :, :few] = mass[:, :few]
        return probability

    @cached_property
    def _crossings(self) -> ManyCrossings:
        """Crossings, read from the folder or simulated."""
        if self._part_of is not None:
            model, parts = self._part_of
            crossings: ManyCrossings = model._crossings.part(parts)  # type: ignore[attr-defined]
            return crossings
        entry = self._entry(partial(ManyCrossings, self.thresholds_nats), ())
        return entry.once(self._simulate_many)

    def _simulate_many(self) -> ManyCrossings:
        run = self.run((), float(self.thresholds_nats[0]))
        options: dict[str, Any] = {"seconds": self.seconds, "trials": self.trials}
        channels = self.circuit.channels
        return simulated_many(run, self.thresholds_nats, channels, **options, seed=self.seed)
