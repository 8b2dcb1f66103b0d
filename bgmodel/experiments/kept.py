"""What a run of an experiment keeps for the next one, while a program edits the manipulation."""

from __future__ import annotations

from collections.abc import Callable, Hashable
from dataclasses import dataclass, field

from bgmodel.bootstrap import RESAMPLES, resampled
from bgmodel.deciding.measures import Behaviour
from bgmodel.support.arrays import Array, Integers
from bgmodel.support.seeds import stream


@dataclass
class Kept:
    """Behaviour and measures of conditions, and the weights of the bootstrap.

    The control, which stays while a manipulation is edited, is then neither simulated nor measured
    again.
    """

    most: int = 12
    behaviour: dict[Hashable, Behaviour] = field(default_factory=dict)
    """Behaviour of each condition."""
    _measures: dict[Hashable, dict[str, Array]] = field(default_factory=dict)
    _weights: tuple[tuple[int, int], Array] | None = None

    def behaviour_of(self, key: Hashable, compute: Callable[[], Behaviour]) -> Behaviour:
        """Return the behaviour of a condition, computed unless it is kept; None is never kept."""
        if key is None:
            return compute()
        if key not in self.behaviour:
            self.behaviour[key] = compute()
            for old in [*self.behaviour][: -self.most]:
                del self.behaviour[old]
                self._measures.pop(old, None)
        return self.behaviour[key]

    def measures(self, key: Hashable, behaviour: Behaviour, weights: Array) -> dict[str, Array]:
        """Return the measures of a condition; the weights are those of its seed and trials."""
        if key is None:
            return behaviour.measures(weights)
        if key not in self._measures:
            self._measures[key] = behaviour.measures(weights)
        return self._measures[key]

    def weights(self, trials: int, seed: int, groups: Integers | None) -> Array:
        """Return the weights (1 + resamples, trials) of the bootstrap; those of groups are new."""
        key = trials, seed
        if groups is None and self._weights is not None and self._weights[0] == key:
            return self._weights[1]
        drawn = resampled(trials, RESAMPLES, stream(seed, "bootstrap"), groups)
        if groups is None:
            self._weights = key, drawn
        return drawn
