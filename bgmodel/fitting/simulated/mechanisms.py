"""Mechanisms that change a circuit's criterion: edits with free numbers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from bgmodel.fitting.parameters import Parameter
from bgmodel.support.arrays import Array

if TYPE_CHECKING:
    from circuits.circuit import Circuit


@dataclass(frozen=True)
class Axis:
    """A number of the circuit to fit, simulated at values equally spaced from bound to bound."""

    parameter: Parameter
    points: int = 9

    @cached_property
    def values(self) -> Array:
        """Simulated values, (points,)."""
        return np.linspace(self.parameter.low, self.parameter.high, self.points)


@dataclass(frozen=True)
class Mechanism:
    """Edits of a circuit with free numbers, and these numbers."""

    edits: tuple[str, ...]  # text with names in braces: ``("dopamine {dopamine}",)``.
    axes: tuple[Axis, ...]  # One for each name.
    about: str = ""
    # Whether it replaces the threshold, which is then fixed unless a fit frees it.
    instead: bool = False

    def apply(self, circuit: Circuit, point: Sequence[float]) -> Circuit:
        """Return the circuit at values of the axes."""
        names = (axis.parameter.name for axis in self.axes)
        values = {name: f"{value:.6g}" for name, value in zip(names, point, strict=True)}
        return circuit.edited(*(edit.format(**values) for edit in self.edits))


NONE = Mechanism((), (), "the threshold alone")
ONSET_ROWS = (
    "add STN_onset like=STN transfer=linear bias_nats=0 baseline_hz=15",
    "add STN_onset->SNr like=STN->SNr weight=1",
)
MECHANISMS = {
    "threshold": NONE,
    "dopamine": Mechanism(
        ("dopamine {dopamine}",),
        (Axis(Parameter("dopamine", 0.6, 1.4, 1.0, "level of dopamine; 1 is the table's")),),
        "the level of dopamine",
        instead=True,
    ),
    "stn_loss": Mechanism(
        ("lesion STN {stn_loss}",),
        (Axis(Parameter("stn_loss", 0.0, 0.4, 0.0, "share of STN that is lost")),),
        "a share of STN that is lost",
        instead=True,
    ),
    "gpe_loss": Mechanism(
        ("lesion GPe {gpe_loss}",),
        (Axis(Parameter("gpe_loss", 0.0, 0.4, 0.0, "share of GPe that is lost")),),
        "a share of GPe that is lost",
        instead=True,
    ),
    "rising_dopamine": Mechanism(
        ("add dopamine amount={dopamine_rise} rise_ms={rise_ms}",),
        (
            Axis(Parameter("dopamine_rise", 0.0, 1.0, 0.0, "what dopamine rises by in a trial"), 7),
            Axis(Parameter("rise_ms", 100.0, 2100.0, 900.0, "its time constant, ms"), 6),
        ),
        "dopamine that rises within a trial",
    ),
    "onset_stn": Mechanism(
        (*ONSET_ROWS, "add STN_onset amount={onset_nats} to_ms=1 decay_ms={decay_ms}"),
        (
            Axis(Parameter("onset_nats", 0.0, 1.2, 0.0, "drive of STN_onset at onset, nats"), 13),
            Axis(Parameter("decay_ms", 200.0, 1000.0, 400.0, "time constant of its decay, ms"), 5),
        ),
        "cells of STN that are driven at onset, decay, and excite SNr of all channels",
    ),
}
"""Mechanisms that change the decision criterion of a circuit, by name."""
