"""A circuit on known evidence: simulated on the readings of each trial, at several gains."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, ClassVar, Self

import numpy as np

from bgmodel.evidence import Evidence
from bgmodel.fitting.known.hazard import lowest_between
from bgmodel.fitting.known.models import LEAK, Values, leaky_sums, read, sizes
from bgmodel.fitting.known.trials import KnownTrials, gaps_s, intervals
from bgmodel.fitting.parameters import Parameter
from bgmodel.fitting.simulated.circuit_model import SIMULATION_SEED
from bgmodel.integrators.basal_ganglia import REFUSED_TIMES, BasalGanglia
from bgmodel.integrators.criterion import gain_of
from circuits.arrays import Array, Integers
from circuits.declaration.table_writer import identity
from circuits.errors import InputError, RangeWarning, quiet, require

if TYPE_CHECKING:
    from circuits.circuit import Circuit

FACTORS = (0.5, 0.75, 1.0, 1.4, 2.0)
"""Gains at which a circuit is simulated, relative to its default; between them OUT of each run is
interpolated by a cubic spline over the logarithm of the gain."""
SIMULATED, FEWEST, MOST = 6000, 8, 32
"""Simulated trials at each gain, and limits of the number of runs of each trial."""
GRID_S = 0.01
"""Times of readings without a common step are rounded to this, s."""
NEVER_NATS = -1e3
PARTS = 8
"""Number of parts of the runs, from which the error of simulation is estimated."""
CHUNKS = 8
"""Trials are simulated in this many parts of similar length."""


@dataclass(frozen=True)
class KnownCircuit:
    """A circuit as a model of decisions on known evidence; mechanisms are edits of it.

    Each trial is simulated ``runs`` times on its readings, with the same noise at all gains. OUT
    after a reading is its lowest value until the next one; probabilities are means over the runs.
    """

    circuit: Circuit
    engine: str = "population"
    runs: int | None = None
    seed: int = SIMULATION_SEED
    sign: ClassVar[int] = 1

    def __post_init__(self) -> None:
        self.circuit.check_nats("a fit of choices on known evidence")

    @property
    def name(self) -> str:
        """Name of the circuit."""
        return self.circuit.name

    def parameters(self, alternatives: int) -> tuple[Parameter, ...]:
        """Return gain, leak (fixed: it would need other simulations), threshold and noise."""
        low, high = self.circuit.readable_nats
        about, gain = "drive of the circuit, nats, per nat of evidence", gain_of(self.circuit)
        return (
            Parameter("gain", gain * FACTORS[0], gain * FACTORS[-1], gain, about),
            LEAK,
            *sizes((low, high, 0.3 * high), (0.01, 2 * high, 0.05 * high), "OUT, nats"),
        )

    def on(self, trials: KnownTrials, values: Mapping[str, float]) -> Simulated:
        """Return its simulated OUT on some trials, of ``values`` the leak, which must be fixed."""
        channels, count = self.circuit.channels, trials.alternatives
        require(channels == count, "circuit", f"must have {count} channels", channels)
        if LEAK.name not in values:
            problem = "of a circuit can't be free: fix it at a value, such as leak_hz=0.5"
            raise InputError(f"leak_hz {problem}", "free")
        gains = self._usable(trials, values[LEAK.name])
        stored = [self._simulated(trials, g, values[LEAK.name]) for g in gains]
        return Simulated(np.stack(stored), gains, trials.seen_places[0])

    def identity(self) -> dict[str, Any]:
        """Return the circuit's hash, engine, runs and seed."""
        about = {"circuit": identity(self.circuit), "engine": self.engine}
        return about | {"runs": self.runs, "seed": self.seed}

    def _usable(self, trials: KnownTrials, leak_hz: float) -> Array:
        evidence, _ = on_grid(trials, leak_hz)
        gains = gain_of(self.circuit) * np.array(FACTORS)
        model = BasalGanglia(self.circuit, self.engine, float(gains[0]), self.seed)
        lead = model.lead_nats(evidence) / model.gain
        usable = lead * gains < REFUSED_TIMES * self.circuit.max_lead_nats
        if usable.sum() < 2:
            model.check_strength(evidence)
            raise InputError(
                f"the evidence is too strong for {self.name}: is it in nats?", "evidence"
            )
        return np.asarray(gains[usable])

    def _simulated(self, trials: KnownTrials, gain: float, leak_hz: float) -> Array:
        evidence, step_s = on_grid(trials, leak_hz)
        starts, ends = intervals(trials)
        runs = self.runs or int(np.clip(SIMULATED // trials.trials, FEWEST, MOST))
        # No trial falls that far: engines are faster if rates aren't stored.
        model = BasalGanglia(self.circuit, self.engine, gain, self.seed).until(NEVER_NATS)
        lowest = np.zeros((runs, trials.trials, starts.shape[1], trials.alternatives))
        with quiet(RangeWarning):
            for chosen, first, part in _parts(evidence, runs):
                at = 0
                for some, _, trace in model.batches(part, first):
                    place = np.arange(at, at + some.trials)
                    run, trial = place // len(chosen), chosen[place % len(chosen)]
                    time_s = trace.time_ms / 1000 - (step_s if _shifted(trials) else 0.0)
                    lowest[run, trial] = lowest_between(
                        trace.out_nats, time_s, starts[trial], ends[trial], trials.seen[trial]
                    )
                    at += some.trials
        return np.asarray(lowest[:, *trials.seen_places])


@dataclass(frozen=True)
class Simulated:
    """OUT of a circuit, stored at several gains."""

    # (gains, runs, seen readings, alternatives): the lowest OUT after each reading, until the next.
    stored: Array
    gains: Array
    trial: Integers  # (seen readings,), the trial of each

    def out(self, values: Values) -> Array:
        """Return OUT (runs, seen readings, alternatives) at gains between those stored."""
        from scipy.interpolate import CubicSpline

        spline = CubicSpline(np.log(self.gains), np.eye(len(self.gains)))
        gains, kind = np.unique(values["gain"], return_inverse=True)
        weights = spline(np.log(np.clip(gains, self.gains[0], self.gains[-1])))
        if len(gains) == 1:
            return np.tensordot(weights[0], self.stored, axes=1)
        return np.asarray(np.einsum("kg,gnka->nka", weights[kind[self.trial]], self.stored))

    def parts(self) -> list[Self]:
        """Return the outputs without each of ``PARTS`` parts of the runs in turn."""
        runs = self.stored.shape[1]
        left = np.array_split(np.arange(runs), min(runs, PARTS)) if runs > 1 else []
        return [replace(self, stored=np.delete(self.stored, some, axis=1)) for some in left]


def on_grid(trials: KnownTrials, leak_hz: float = 0.0) -> tuple[Evidence, float]:
    """Return the readings before the response as evidence with a fixed step, and the step, s.

    The mean of all readings is subtracted; a leak is included as changes of the sums.
    """
    values, time_s = read(trials)
    seen = np.isfinite(time_s)
    values = values - values[seen].mean() * seen[:, :, None]
    step_s = _step_s(trials)
    _, ends = intervals(trials)
    shift = 1 if _shifted(trials) else 0
    place = np.where(seen, np.round(np.where(seen, time_s, 0.0) / step_s), 0).astype(int) + shift
    last = np.where(seen, ends, 0.0).max(axis=1)
    steps = np.maximum(np.round(last / step_s).astype(int) + shift - 1, 1)
    gridded = np.zeros((trials.trials, max(int(steps.max()), 1), trials.alternatives))
    row, column = np.nonzero(seen)
    np.add.at(gridded, (row, place[row, column] - 1), values[row, column])
    if leak_hz:
        when = step_s * np.broadcast_to(np.arange(gridded.shape[1]), gridded.shape[:2])
        gridded = np.diff(leaky_sums(gridded, when, leak_hz), axis=1, prepend=0.0)
    gridded[np.arange(gridded.shape[1]) >= steps[:, None]] = 0.0
    with quiet():
        evidence = Evidence(gridded, step_ms=1000 * step_s, lengths=steps, baseline=0.0)
    return evidence, step_s


def _step_s(trials: KnownTrials) -> float:
    """Return the common step of the times of all readings, s, or that of the grid."""
    time_s, gaps = trials.time_s[np.isfinite(trials.time_s)], gaps_s(trials)
    least = float(gaps.min()) if gaps.size else float(time_s.max())
    least = least if least > 0 else GRID_S
    regular = np.abs(time_s / least - np.round(time_s / least)).max() < 1e-6
    return least if regular else GRID_S


def _shifted(trials: KnownTrials) -> bool:
    """Whether a reading comes so early that the evidence has to begin a step before it."""
    first = trials.time_s[np.isfinite(trials.time_s)].min()
    return bool(np.round(first / _step_s(trials)) < 1)


def _parts(evidence: Evidence, runs: int) -> Iterator[tuple[Integers, int, Evidence]]:
    """Yield trials of similar length, the number of their first run, and all their runs."""
    order = np.argsort(evidence.readings, kind="stable")
    first = 0
    for chosen in np.array_split(order, min(CHUNKS, len(order))):
        readings = np.asarray(evidence.readings)[chosen]
        values = evidence.log_likelihood[chosen][:, : int(readings.max())]
        with quiet():
            part = replace(
                evidence,
                log_likelihood=np.tile(values, (runs, 1, 1)),
                lengths=np.tile(readings, runs),
                numbers=None,
            )
        yield chosen, first, part
        first += part.trials
