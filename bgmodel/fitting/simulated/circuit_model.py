"""A circuit as a model of choices and times, simulated once for any drift and threshold.

Mechanisms that change its criterion are edits with free numbers.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Self, TypeVar

import numpy as np
import numpy.typing as npt

from bgmodel.deciding.trace import Trace
from bgmodel.fitting.algorithms import BIAS, SENSITIVITY, distinct
from bgmodel.fitting.parameters import RESPONSE, Parameter
from bgmodel.fitting.responses import BIN_S, Grid
from bgmodel.fitting.simulated.crossings import (
    DRIFTS,
    FirstPassageTimes,
    Run,
    interpolated,
    simulated,
)
from bgmodel.fitting.simulated.error import BOUNDS, PARTS, InParts, decided, ideal, matched
from bgmodel.integrators.basal_ganglia import ROUNDING_NATS, BasalGanglia
from bgmodel.support import __version__
from bgmodel.support.checks import whole
from circuits.arrays import Array, Truths
from circuits.declaration.motifs import URGENCY_RISE_MS
from circuits.declaration.table_writer import identity
from circuits.engines import engine_of
from circuits.errors import RangeWarning, quiet, require
from circuits.store import Entry

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

    # Text with names in braces, ``("dopamine {dopamine}",)``; ``{readout}`` is the output nucleus.
    edits: tuple[str, ...]
    axes: tuple[Axis, ...]  # One for each other name.
    # Whether it replaces the threshold, which is then fixed unless a fit frees it.
    instead: bool = False

    def apply(self, circuit: Circuit, point: Sequence[float]) -> Circuit:
        """Return the circuit at values of the axes."""
        names = (axis.parameter.name for axis in self.axes)
        values = {name: f"{value:.6g}" for name, value in zip(names, point, strict=True)}
        every = (edit.format(readout=circuit.readout, **values) for edit in self.edits)
        return circuit.edited(*every)


NONE = Mechanism((), ())
ONSET_ROWS = (
    "add STN_onset like=STN transfer=linear bias_nats=0 baseline_hz=15",
    "add STN_onset->SNr like=STN->SNr weight=1",
)
MECHANISMS = {
    "threshold": NONE,
    "dopamine": Mechanism(
        ("dopamine {dopamine}",),
        (Axis(Parameter("dopamine", 0.6, 1.4, 1.0, "level of dopamine; 1 is the table's")),),
        instead=True,
    ),
    "stn_loss": Mechanism(
        ("lesion STN {stn_loss}",),
        (Axis(Parameter("stn_loss", 0.0, 0.4, 0.0, "share of STN that is lost")),),
        instead=True,
    ),
    "gpe_loss": Mechanism(
        ("lesion GPe {gpe_loss}",),
        (Axis(Parameter("gpe_loss", 0.0, 0.4, 0.0, "share of GPe that is lost")),),
        instead=True,
    ),
    "rising_dopamine": Mechanism(
        ("add dopamine amount={dopamine_rise} rise_ms={rise_ms}",),
        (
            Axis(Parameter("dopamine_rise", 0.0, 1.0, 0.0, "what dopamine rises by in a trial"), 7),
            Axis(Parameter("rise_ms", 100.0, 2100.0, 900.0, "its time constant, ms"), 6),
        ),
    ),
    # Cells of STN that are driven at onset, decay, and excite SNr of all channels.
    "onset_stn": Mechanism(
        (*ONSET_ROWS, "add STN_onset amount={onset_nats} to_ms=1 decay_ms={decay_ms}"),
        (
            Axis(Parameter("onset_nats", 0.0, 1.2, 0.0, "drive of STN_onset at onset, nats"), 13),
            Axis(Parameter("decay_ms", 200.0, 1000.0, 400.0, "time constant of its decay, ms"), 5),
        ),
    ),
    # OUT falls with time, as the motif lets it, by a size that is fitted.
    "urgency": Mechanism(
        (f"add {{readout}} amount=-{{urgency_nats}} rise_ms={URGENCY_RISE_MS:g}",),
        (Axis(Parameter("urgency_nats", 0.0, 1.2, 0.0, "what OUT falls by in the end, nats")),),
    ),
}
"""Mechanisms that change the decision criterion of a circuit, by name."""


NOISE_NATS = 2.0
"""Default noise of the circuit's evidence: standard deviation after one second, nats."""
LEVELS = 60
"""Number of thresholds at which crossings are stored."""
LOWEST_LOG_ODDS, HIGHEST_LOG_ODDS = 0.15, 2.8
"""Range of those thresholds for two channels, within that of the read-out and below OUT at rest."""
TRIALS = 16_000
"""Trials at each drift; a fit warns if they are too few for the data."""
SIMULATION_SEED = 24_001
THRESHOLD = "threshold_nats"
Crossings = TypeVar("Crossings")
STORED = ("bins", "choice", "evidence")
"""Fields of crossings that are stored."""
BIASES_NATS = np.linspace(-0.2, BIAS.high, 8)
"""Biases at which trials are simulated, equally spaced; larger negative ones are mirror images."""


@dataclass(frozen=True)
class CircuitModel(InParts):
    """A circuit of two channels as a model of choices and times.

    ``noise_nats`` is the noise of the accumulated evidence after one second, as the difference of
    both channels: it selects which part of the circuit's range is used.
    """

    circuit: Circuit
    engine: str = "population"
    mechanism: Mechanism = NONE  # Parameters to fit other than sensitivity and threshold.
    noise_nats: float = NOISE_NATS
    seconds: float = 3.0  # length of the stored trials, s
    trials: int = TRIALS  # number at each drift, at least ``PARTS``
    seed: int = SIMULATION_SEED
    folder: Path | None = None  # keeps stored crossings, so that none is computed twice
    # Not among the arguments: a model with other trials or another mechanism starts an empty one.
    _kept: dict[tuple[float, ...], FirstPassageTimes] = field(
        default_factory=dict, repr=False, init=False
    )
    _part_of: tuple[CircuitModel, Truths] | None = field(default=None, repr=False)

    fewest_channels: ClassVar[int] = 2
    most_channels: ClassVar[int] = 2

    def __post_init__(self) -> None:
        channels, few, most = self.circuit.channels, self.fewest_channels, self.most_channels
        number = "two" if few == most else f"{few} to {most}"
        require(
            few <= channels <= most, "circuit", f"must have {number} channels for a fit", channels
        )
        self.circuit.check_nats("a fit of choices and times")
        engine_of(self.engine)
        whole("trials", self.trials, PARTS)  # their parts give the simulation error

    @property
    def threshold_name(self) -> str:
        """``threshold_nats``, or the parameter that replaces it."""
        return self.mechanism.axes[0].parameter.name if self.mechanism.instead else THRESHOLD

    @cached_property
    def thresholds_nats(self) -> Array:
        """Thresholds at which crossings are stored, increasing."""
        lowest = LOWEST_LOG_ODDS - float(np.log(self.circuit.channels - 1))
        odds = np.linspace(HIGHEST_LOG_ODDS, lowest, LEVELS)
        return np.asarray(np.log1p(np.exp(-odds)))

    @cached_property
    def parameters(self) -> tuple[Parameter, ...]:
        """Sensitivity, threshold, parameters of the axes, bias, and those of responses."""
        low, high = float(self.thresholds_nats[0]), float(self.thresholds_nats[-1])
        about = "OUT at which it decides, in the circuit's nats"
        free = not self.mechanism.instead
        threshold = Parameter(THRESHOLD, low, high, 0.25, about, free=free)
        return (SENSITIVITY, threshold, *self._more, *RESPONSE)

    @property
    def _more(self) -> tuple[Parameter, ...]:
        """Parameters at whose values trials are simulated."""
        return (*(axis.parameter for axis in self.mechanism.axes), BIAS)

    def identity(self) -> dict[str, object]:
        """Return all that its predictions depend on."""
        return {
            "model": "circuit",
            "circuit": identity(self.circuit),
            "engine": self.engine,
            "edits": list(self.mechanism.edits),
            "axes": {axis.parameter.name: axis.values.tolist() for axis in self.mechanism.axes},
            "noise_nats": self.noise_nats,
            "seconds": self.seconds,
            "trials": self.trials,
            "seed": self.seed,
            "drifts": list(DRIFTS),
            "thresholds": [LEVELS, LOWEST_LOG_ODDS, HIGHEST_LOG_ODDS],
        }

    def decided(self, values: Mapping[str, Array], strength: Array, grid: Grid) -> Array:
        """Return the probability of a decision in each bin; see ``algorithms.Model``."""
        names = (THRESHOLD, *(each.name for each in self._more))
        none = np.zeros(len(strength))
        settings = np.stack([values.get(name, none) for name in names], axis=1)
        mirrored = settings[:, -1] < 0
        settings[:, -1] = np.abs(settings[:, -1])
        drift = values[SENSITIVITY.name] * np.where(mirrored, -strength, strength)
        probability = np.zeros((len(strength), 2, grid.bins))
        for setting in distinct(settings):
            cells = (settings == setting).all(axis=1)
            threshold, *point, bias = map(float, setting)
            corners = list(_corners(self.mechanism.axes, point))
            for size, weight in _near(bias):
                near = [(self.biased(corner, size), share) for corner, share in corners]
                probability[cells] += weight * decided(near, threshold, drift[cells], grid)
        probability[mirrored] = probability[mirrored, ::-1]
        return probability

    def stored(self, point: tuple[float, ...], bias: float = 0.0) -> FirstPassageTimes:
        """Return the crossings at values of the axes and a bias, nats, read or simulated."""
        key = (*point, bias) if bias else point
        if key not in self._kept:
            if self._part_of is not None:
                model, parts = self._part_of
                self._kept[key] = model.stored(point, bias).part(parts)
            else:
                crossings = self.entry(point, bias).once(lambda: self._simulate(point, bias))
                if not bias:
                    crossings = replace(crossings, control=matched(crossings, self._walks))
                self._kept[key] = crossings
        return self._kept[key]

    def biased(self, point: tuple[float, ...], size: float) -> FirstPassageTimes:
        """Return the crossings with a bias to response 1, and those with the opposite bias."""
        if not size:
            return self.stored(point)
        key = (*point, size, -size)
        if key not in self._kept:
            self._kept[key] = replace(
                self.stored(point, size),
                control=self.stored(point).control,
                opposite=self.stored(point, -size),
            )
        return self._kept[key]

    @cached_property
    def _walks(self) -> FirstPassageTimes:
        bounds = np.linspace(HIGHEST_LOG_ODDS * 1.1, 0.1, BOUNDS) / self.noise_nats
        return simulated(ideal, -bounds, seconds=self.seconds, trials=self.trials, seed=self.seed)

    def _part(self, parts: Truths) -> Self:
        return replace(self, _part_of=(self, parts))

    def _key(self, point: tuple[float, ...], bias: float = 0.0) -> dict[str, Any]:
        key = {**self.identity(), "circuit": identity(self.mechanism.apply(self.circuit, point))}
        key["thresholds_nats"] = self.thresholds_nats.tolist()
        more: dict[str, Any] = {"centred": True} if self.circuit.centred else {}
        more |= {"bias_nats": bias} if bias else {}
        return {n: value for n, value in key.items() if n not in ("axes", "edits")} | more

    def entry(self, point: tuple[float, ...], bias: float = 0.0) -> Entry[FirstPassageTimes]:
        """Return the place of the crossings at values of the axes and a bias."""
        known = partial(FirstPassageTimes, self.thresholds_nats, np.array(DRIFTS))
        return self._entry(known, point, bias)

    def _entry(
        self, known: Callable[..., Crossings], point: tuple[float, ...], bias: float = 0.0
    ) -> Entry[Crossings]:
        return Entry(
            self.folder, __version__, self._key(point, bias),
            lambda crossings: {name: getattr(crossings, name) for name in STORED},
            lambda arrays: known(**arrays),
        )  # fmt: skip

    def run(self, point: tuple[float, ...], lowest_nats: float, bias: float = 0.0) -> Run:
        """Return the ``crossings.Run`` at a point; trials below ``lowest_nats`` may end early."""
        circuit = self.mechanism.apply(self.circuit, point)
        model = BasalGanglia(circuit, self.engine, seed=self.seed)
        model = model.until(lowest_nats - ROUNDING_NATS)
        model = replace(model, engine=model.engine.tuned(workers=2, rates=False))
        # An engine without dynamics responds at once, and a reading is complete at its end.
        late_ms = 0.0 if model.engine.timed else 1000 * BIN_S

        def run(read: Array, first: int) -> Trace:
            # A random walk leaves any range; the effect of that is included in the crossings.
            with quiet(RangeWarning):
                done = model.run_drive(self._drive(read, bias), 1000 * BIN_S, first)
            return Trace(done.output_nats, done.time_ms + late_ms, step_ms=1000 * BIN_S)

        return run

    def _drive(self, read: Array, bias: float) -> Array:
        """Return the drive of accumulated evidence, minus its mean if the table requires it."""
        drive = self.noise_nats * read
        if bias:
            drive[..., int(bias < 0)] += abs(bias)
        if not self.circuit.centred:
            return drive
        drive = np.maximum(drive, drive.max(axis=2, keepdims=True) - self.circuit.max_deficit_nats)
        return np.asarray(drive - drive.mean(axis=2, keepdims=True))

    def _simulate(self, point: tuple[float, ...], bias: float) -> FirstPassageTimes:
        run = self.run(point, float(self.thresholds_nats[0]), bias)
        return simulated(
            run, self.thresholds_nats, seconds=self.seconds, trials=self.trials, seed=self.seed
        )


def _near(bias: float) -> list[tuple[float, float]]:
    rows = len(BIASES_NATS)
    place = float(np.interp(bias, BIASES_NATS, np.arange(rows)))
    # Rounding must not give a bias of 0 neighbours.
    return [
        (round(float(BIASES_NATS[row]), 6), weight)
        for row, weight in interpolated(round(place, 9), rows)
    ]


def _corners(
    axes: Sequence[Axis], values: npt.ArrayLike
) -> Iterator[tuple[tuple[float, ...], float]]:
    sides = []
    for axis, value in zip(axes, np.asarray(values, float), strict=True):
        place = float(np.interp(value, axis.values, np.arange(axis.points)))
        low = min(int(place), axis.points - 1)
        both = ((low, low + 1 - place), (low + 1, place - low))
        sides.append([(float(axis.values[k]), share) for k, share in both if share > 0])
    for corner in itertools.product(*sides):
        yield tuple(value for value, _ in corner), math.prod(share for _, share in corner)
