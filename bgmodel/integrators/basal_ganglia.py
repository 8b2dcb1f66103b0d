"""A circuit as an integrator, like ``Msprt``."""

from __future__ import annotations

from collections.abc import Iterator
from copy import copy
from dataclasses import dataclass, replace
from types import NoneType
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from bgmodel.deciding.calibration import warn_of_decisions, warn_of_early_decisions
from bgmodel.deciding.decision import Decision, any_crossing, check_decision, first_crossing, joined
from bgmodel.deciding.trace import Trace
from bgmodel.evidence import Evidence, check_evidence
from bgmodel.integrators.criterion import (
    LEAD_MS,
    DefaultGain,
    LoweredGain,
    fitting_gain,
    gain_of,
    largest_lead,
    lead_of,
    readout_of,
    unfiltered,
)
from bgmodel.integrators.session import Reader, Session
from bgmodel.support.checks import check_flag, check_positive, whole
from bgmodel.support.processes import advance, check_memory
from bgmodel.support.saved import Facts
from circuits.activity import RateMeans, beyond_range, checked_drive, warn_beyond_range
from circuits.anatomy import checked_circuit
from circuits.arrays import Array
from circuits.circuit import Circuit
from circuits.declaration.courses import warn_of_late
from circuits.declaration.table import NATS
from circuits.differences import ignored_edits
from circuits.engines import EngineOrName
from circuits.errors import (
    BgmodelWarning,
    EditWarning,
    InputError,
    NoiseWarning,
    RangeWarning,
    quiet,
)

if TYPE_CHECKING:
    from circuits.activity import Activity

BATCH = 250
"""Number of trials in one batch of ``BasalGanglia.batches``."""
WIDE_BATCH, WIDE_NUMBERS = 2000, 4_000_000
"""Without rates: largest number of trials in a batch, and of values of OUT. The rate engine runs
large batches faster."""
ROUNDING_NATS = 0.01
"""A trial is dropped once OUT is this far below its threshold."""
VARIED = 1.1
"""How far the lead of other trials of a task may exceed that to which a gain was fitted."""
REFUSED_TIMES = 8.0
"""A lead this many times the circuit's largest is refused: a third of decisions are then late."""
COARSE_MS, COARSE_SHARE = 5.0, 0.1
"""Warn if samples of OUT are further apart than both (ms, share of a step). With readings every
50 ms, sampling every 5, 10 and 50 ms lengthens the mean decision time by 5, 13 and 58 ms."""
NOISE_SHARE = 0.02
"""Largest tolerated share of trials in which noise alone crosses a threshold within 500 ms."""


@dataclass(frozen=True, repr=False)
class BasalGanglia(Facts):
    """A basal ganglia circuit that integrates evidence; ``run`` returns OUT, as for ``Msprt``.

    Parameters
    ----------
    circuit : Circuit or str
        The table, a name (2 channels) or a .toml file (the file's number of channels).
    engine : Engine or str
        A record of ``circuits.engines`` with its options, such as ``Spikes(spikes=("STN",))``, so
        that ``activity`` keeps spikes, or the name of one, with its defaults. Populations is the
        fastest engine that includes spiking noise.
    gain : float, optional
        Drive, in the circuit's unit, per nat of evidence, kappa: in nats OUT is then
        ``-ln softmax(kappa L)``. By default that of the circuit, lowered where the evidence would
        outrun it: see ``adapted_to``. Required for a circuit without a default.
    seed : int, optional
        Key of the noise.

    Raises
    ------
    ValueError
        For an argument of the wrong kind or out of range.

    Warns
    -----
    UserWarning
        If the engine ignores a number of the circuit that was edited.
    """

    circuit: Circuit
    engine: EngineOrName = EngineOrName("population")
    gain: float = None  # type: ignore[assignment]  # a number after __post_init__
    seed: int | None = 0

    def __post_init__(self) -> None:
        object.__setattr__(self, "circuit", checked_circuit(self.circuit))
        if self.gain is None:
            object.__setattr__(self, "gain", DefaultGain(gain_of(self.circuit)))
        check_positive(gain=self.gain)
        if self.seed is not None:
            whole("seed", self.seed, 0)
        if ignored := ignored_edits(self.circuit, self.engine):
            EditWarning.warn(
                f"the {self.engine} engine ignores these edits of {self.circuit.name}: "
                f"{'; '.join(ignored)}; choose another engine, or remove them"
            )

    def facts(self) -> dict[str, str]:
        """Return the circuit, its engine, its gain and its noise."""
        facts = {
            "circuit": self.circuit.name,
            "channels": f"{self.circuit.channels}",
            "engine": self.engine.id,
            "gain": f"{self.gain:g}" + (" or less" if self._adapts else ""),
            "seed": f"{self.seed}",
        }
        return facts | {name: f"{value}" for name, value in self.engine.changed().items()}

    def adapted_to(self, evidence: Evidence) -> BasalGanglia:
        """Return the model at the gain that fits the evidence: the gain that every run uses.

        A model made without ``gain`` has the default gain of its circuit, or the largest
        at which the evidence gains no more than ``circuit.max_lead_nats`` per 100 ms, whichever is
        lower (``criterion.fitting_gain``). An edited circuit has the gain of the unedited one. The
        mean over all trials counts: run parts of some evidence on the model adapted to all of it.
        """
        if not self._adapts:
            return self
        model = copy(self)
        most = largest_lead(self.circuit)
        gain = fitting_gain(self.gain, most, lead_of(check_evidence(evidence)))
        object.__setattr__(model, "gain", gain)
        return model

    @property
    def unadapted(self) -> BasalGanglia:
        """The model at its gain whatever the evidence, for evidence that is not known before."""
        return replace(self, gain=float(self.gain)) if self._adapts else self

    @property
    def _adapts(self) -> bool:
        return isinstance(self.gain, DefaultGain) and largest_lead(self.circuit) < np.inf

    def run(self, evidence: Evidence) -> Trace:
        """Return OUT (trials, ticks, hypotheses) from the onset of evidence, in kappa-nats.

        These are nats of evidence times the circuit's gain kappa. Readings come at ``onset_ms + k
        step_ms``; each is held for a step, the last one for two, so that the circuit can respond to
        it. An informative foreperiod is simulated as well.
        """
        model = self.adapted_to(evidence)
        return model.trace(model.activity(evidence), evidence)

    def drive(self, evidence: Evidence) -> Array:
        """Return the drive: raw evidence, or that of ``drive_of`` if the circuit is centred.

        Raises
        ------
        ValueError
            If each channel gets its own evidence and that has no baseline, the foreperiod is
            informative and the mean over channels is subtracted, or noisy OUT is not filtered.
        """
        expected = check_evidence(evidence).expectancy_nats
        if self.engine.noisy and (doubt := unfiltered(self.circuit)):
            raise InputError(f"{self.circuit.name}: {doubt}", "readout_tau_ms", 0)
        if not self.raw:
            if expected is not None:
                raise InputError(
                    "the expectation is common to all channels, and their mean is removed from the "
                    f"input of {self.circuit.name}: none of it would reach the circuit",
                    "evidence",
                )
            return drive_of(evidence, self.gain, self.circuit.max_deficit_nats)
        totals = evidence.own_totals
        if expected is not None:
            before = totals[:, :1] + expected[:, :, None]
            totals = np.concatenate([before, totals + expected[:, -1:, None]], axis=1)
        return self.gain * totals

    def driven(self, evidence: Evidence) -> tuple[Array, float]:
        """Return the drive with the further inputs of the circuit, and the time between its steps.

        Raises
        ------
        ValueError
            Unless the evidence has one input for each of the circuit's, or none.
        """
        drive, inputs = self.drive(evidence), evidence.inputs_nats
        if inputs is None:
            return drive, evidence.step_ms
        names = self.circuit.more_inputs
        if inputs.shape[2] != len(names):
            place = f'{self.circuit.name} has {len(names)}: circuit.with_inputs("STN") adds one'
            raise InputError(f"the evidence has {inputs.shape[2]} inputs, {place}", "inputs_nats")
        per_step = inputs.shape[1] // (evidence.steps + 1)
        before = evidence.foreperiod_steps * per_step
        inputs = np.pad(inputs, ((0, 0), (before, 0), (0, 0)))
        both = np.concatenate([np.repeat(drive, per_step, axis=1), inputs], axis=2)
        return both, evidence.step_ms / per_step

    @property
    def raw(self) -> bool:
        """Whether each channel gets its own evidence, without subtraction of the mean."""
        return not self.circuit.centred

    def trace(self, activity: Activity, evidence: Evidence) -> Trace:
        """Return the OUT of an activity as a trace on the evidence's clock.

        A trial ends a step after its last reading, however long other trials are.
        """
        foreperiod = evidence.foreperiod_steps
        time_ms = activity.time_ms + (0.0 if foreperiod else evidence.onset_ms)
        steps = foreperiod + 1
        ends = len(time_ms) * (evidence.readings + steps) // (evidence.steps + steps)
        return Trace(
            activity.output_nats,
            time_ms,
            evidence.onset_ms,
            evidence.step_ms,
            ends,
            evidence.trial_numbers,
            replace(readout_of(self.circuit), warn_of_noise=self.warn_of_noise),
            evidence.truth,
            float(self.gain),
        )

    def decide(
        self,
        evidence: Evidence,
        threshold: float | None = None,
        *,
        posterior: float | None = None,
        forced: bool = True,
        rates: RateMeans | None = None,
    ) -> Decision:
        """Run the circuit to a decision, with every check and warning of ``bgmodel circuit run``.

        Trials are run in batches; where the engine supports it, a trial ends at its
        decision.

        Parameters
        ----------
        evidence : Evidence
            Readings of all trials.
        threshold : float, optional
            OUT at which the circuit decides, in the circuit's unit.
        posterior : float, optional
            Posterior at which the circuit decides, in its nats; replaces the threshold.
        forced : bool
            Whether the deadline forces a response.
        rates : RateMeans, optional
            Filled with the rates of all trials, which then run to their ends.

        Raises
        ------
        ValueError
            If the circuit would decide without evidence at that threshold or can never reach it.

        Warns
        -----
        UserWarning
            If the evidence leaves the circuit's range, noise alone crosses the threshold, most
            trials are decided by the deadline or before their first reading, or posteriors at the
            decision differ from the proportion correct.
        """
        if not isinstance(rates, (RateMeans, NoneType)):
            raise InputError.of("rates", "must be a RateMeans() of circuits.activity", rates)
        check_flag("forced", forced)
        level = self.threshold(threshold, posterior)
        model = self.adapted_to(evidence)
        model.warn_beyond_range(evidence)
        model.warn_of_noise(level)
        decision = model.decided(evidence, level, forced=forced, rates=rates)
        check_decision(decision, level, forced=forced, of_test=False)
        warn_of_decisions(evidence, decision)
        # An edit may well shift the criterion, and an expectation is not among the readings.
        intact = self.circuit.unedited is None and self.circuit.unit == NATS
        if intact and level > 0 and evidence.expectancy_nats is None:
            warn_of_early_decisions(evidence, decision, model.gain, float(np.exp(-level)))
        return decision

    def decided(
        self,
        evidence: Evidence,
        level: float,
        *,
        forced: bool = True,
        rates: RateMeans | None = None,
        first_trial: int = 0,
    ) -> Decision:
        """Return the decisions at one threshold on OUT, without the checks of ``decide``.

        For callers that check and warn themselves, such as experiments. Trial t has the noise of
        ``first_trial + t``.
        """
        model = self.adapted_to(evidence)
        model = model.until(level - ROUNDING_NATS) if rates is None else model
        parts = []
        for part, activity, trace in model.batches(evidence, first_trial):
            parts.append(first_crossing(trace, level, forced=forced, checked=False))
            if rates is not None:
                rates.add(activity)
            advance(part.trials)
        return replace(joined(parts), truth=evidence.truth)

    def session(
        self,
        threshold: float | None = None,
        *,
        posterior: float | None = None,
        step_ms: float = 50.0,
        t_max: int = 200,
        prior: npt.ArrayLike | None = None,
        baseline: float | None = None,
        forced: bool = True,
        first_trial: int = 0,
    ) -> Session:
        """Return a session that decides as readings come; options as for ``Session``.

        Raises
        ------
        ValueError
            As ``decide``; if the engine takes all readings of a trial at once; if each channel gets
            its own evidence and there is no baseline.

        Warns
        -----
        UserWarning
            Once, if a reading leaves the circuit's range, and if noise alone crosses the threshold.
            The mean strength of evidence is unknown beforehand, so that the gain is not adapted:
            see ``check_strength`` and ``adapted_to``.
        """
        level = self.threshold(threshold, posterior)
        self.warn_of_noise(level)
        warn_of_late(self.circuit.courses, (t_max + 1) * step_ms)
        nothing = np.zeros((1, 1, self.circuit.channels))
        empty = Evidence(nothing, prior=prior, step_ms=step_ms, baseline=baseline)  # type: ignore[arg-type]

        doubts: list[str] = []  # warn once per session, not at every reading

        def begin(trial: int) -> Reader:
            stream = self.engine.stream(
                self.circuit, step_ms=step_ms, steps=t_max + 1, seed=self.seed, trial=trial
            )
            stream.add(self.drive(empty)[0, 0])

            def read(evidence: Evidence) -> Trace:
                drive = self.drive(evidence)[:, -1:]
                if not doubts and (doubt := beyond_range(self.circuit, drive)):
                    doubts.append(doubt)
                    RangeWarning.warn(doubt)
                stream.add(drive[0, 0])
                known, numbers = readout_of(self.circuit), evidence.trial_numbers
                out = stream.out[None, : stream.samples]
                gain = float(self.gain)
                return Trace(out, stream.time_ms, 0.0, step_ms, None, numbers, known, gain=gain)

            return read

        return Session(
            begin, self.circuit.channels, level, step_ms=step_ms, t_max=t_max, prior=prior,
            baseline=baseline, forced=forced, first_trial=first_trial,
        )  # fmt: skip

    def threshold(self, threshold: float | None, posterior: float | None) -> float:
        """Return the checked threshold on OUT, given as a threshold or as a posterior."""
        return readout_of(self.circuit).one(threshold, posterior, self.circuit.channels)

    def activity(
        self, evidence: Evidence, first_trial: int = 0, *, checked: bool = True
    ) -> Activity:
        """Return the activity of the circuit; trial t has the noise of ``first_trial + t``.

        Warns if evidence is stronger than the circuit can track, see ``check_strength``, unless
        ``checked`` is false: for a part of evidence to all of which the model is adapted.
        """
        model = self._checked(evidence) if checked else self
        return model.run_drive(*model.driven(evidence), first_trial)

    def announced(self, what: str, evidence: Evidence, runs: int = 1) -> list[str]:
        """Return what a run of some circuits will do, as text; NoMemoryError without its memory."""
        lines = []
        if self.raw and evidence.baseline:
            less = f"minus the baseline of a reading: {evidence.baseline:.3g} nats"
            lines.append(f"each channel gets its own evidence, {less}")
        at_once, steps = min(self.batch(evidence), evidence.trials), evidence.steps + 1
        self.check_memory(at_once, steps, evidence.step_ms)
        memory = self.memory_gb(at_once, steps, evidence.step_ms)
        circuits = f"{runs} circuits, " if runs > 1 else ""
        lines.append(
            f"{what} {self.circuit.name} on {self.engine}, {circuits}{evidence.trials} trials of "
            f"up to {steps * evidence.step_ms / 1000:.2g} s"
            f"{f', {memory:.1f} GB of memory' if memory >= 1 else ''}"
        )
        return lines

    def with_spikes(self) -> BasalGanglia:
        """Return the model whose activity has the spikes of all cells, if its engine has any."""
        names = self.circuit.spiking()
        return replace(self, engine=self.engine.recording(names))

    def _checked(self, evidence: Evidence) -> BasalGanglia:
        """Return the model adapted to evidence, after the checks that concern all of it."""
        model = self.adapted_to(evidence)
        model.check_strength(evidence)
        model._warn_of_coarse_samples(evidence)
        steps = evidence.foreperiod_steps + evidence.steps + 1
        warn_of_late(model.circuit.courses, steps * evidence.step_ms)
        return model

    def run_drive(self, drive: npt.ArrayLike, step_ms: float, first_trial: int = 0) -> Activity:
        """Return the activity under a drive (trials, steps, channels) in the circuit's nats."""
        trials, steps, _ = checked_drive(self.circuit, drive).shape
        self.check_memory(trials, steps, step_ms)
        return self.engine.run(
            self.circuit, drive, step_ms=step_ms, seed=self.seed, first_trial=first_trial
        )

    def check_memory(self, trials: int, steps: int, step_ms: float) -> None:
        """Raise ValueError if there is not enough memory for this many trials at a time."""
        check_memory(
            self._memory_bytes(trials, steps, step_ms),
            f"{trials} trials of {self.circuit.name}, engine {self.engine},",
        )

    def memory_gb(self, trials: int, steps: int, step_ms: float) -> float:
        """Return the approximate memory for this many trials at a time, GB."""
        return self._memory_bytes(trials, steps, step_ms) / 1e9

    def _memory_bytes(self, trials: int, steps: int, step_ms: float) -> float:
        samples = self.engine.samples(steps, step_ms)
        return self.engine.memory_bytes(self.circuit, trials, samples)

    def warn_beyond_range(self, evidence: Evidence) -> None:
        """Warn if the evidence leaves the range in which the circuit works."""
        warn_beyond_range(self.circuit, self.adapted_to(evidence).drive(evidence))

    def lead_nats(self, evidence: Evidence) -> float:
        """Return the mean lead gained by the best-supported channel, nats of drive.

        It is that of ``lead_of``, at the gain that the evidence is run with.
        """
        return self.adapted_to(evidence).gain * lead_of(evidence)

    def check_strength(self, evidence: Evidence) -> None:
        """Warn if evidence is stronger than the circuit can track.

        An engine without dynamics (algebra) tracks any evidence.

        Raises
        ------
        ValueError
            If the evidence gains at least ``REFUSED_TIMES`` the largest lead of the circuit, or
            is not an ``Evidence``.
        """
        check_evidence(evidence)
        most = self.circuit.max_lead_nats
        if not (self.engine.timed and np.isfinite(most)):
            return
        lead = self.lead_nats(evidence)
        # A hypothesis that is ruled out has infinite nats: the engines refuse it.
        allowed = most * (VARIED if isinstance(self.gain, LoweredGain) else 1)
        if lead <= allowed or not np.isfinite(lead):
            return
        warning = (
            f"the evidence is too strong for {self.circuit.name}: one channel gains a lead of "
            f"{lead:.3g} nats of drive per {max(LEAD_MS, evidence.step_ms):g} ms, the circuit "
            f"tracks up to {most:.3g}, and beyond that decisions come late or never"
        )
        if lead >= REFUSED_TIMES * most:
            raise InputError(f"{warning}; lower the gain or give weaker evidence", "evidence")
        RangeWarning.warn(warning)

    def _warn_of_coarse_samples(self, evidence: Evidence) -> None:
        """Warn if OUT is sampled so rarely that decision times are overestimated."""
        sample_ms = self.engine.sample_ms
        most = max(COARSE_MS, COARSE_SHARE * evidence.step_ms)
        if sample_ms > most:
            BgmodelWarning.warn(
                f"sample_ms = {sample_ms:g}: decisions are detected only at samples of OUT, so "
                f"decision times are overestimated; give {most:g} or less"
            )

    def out_at_rest(self, trials: int = 40) -> Array:
        """Return OUT (trials, ticks, channels) in 500 ms of noise without evidence."""
        silence = np.zeros((trials, 1, self.circuit.channels))
        resting = replace(self, engine=self.engine.at_rest())
        return np.asarray(resting.run_drive(silence, step_ms=500.0).output_nats)

    def warn_of_noise(self, threshold_nats: float) -> None:
        """Warn if noise alone crosses a threshold."""
        if not (self.engine.noisy and self.engine.threaded):
            return
        out = self.out_at_rest()
        share = any_crossing(out, threshold_nats).mean()
        if share > NOISE_SHARE:
            NoiseWarning.warn(
                f"without evidence, noise takes OUT below the threshold of {threshold_nats:.2f} "
                f"nats in {share:.0%} of trials within 500 ms: OUT rests at {out.mean():.2f} +- "
                f"{out.std():.2f}; give a lower threshold, or a longer readout_tau_ms "
                f"({self.circuit.readout_tau_ms:g} ms) or more cells"
            )

    def until(self, level_nats: float, *, rates: bool = False) -> BasalGanglia:
        """Return the model with trials dropped below a level of OUT, if its engine supports it."""
        return replace(self, engine=self.engine.until(level_nats, rates=rates))

    def batch(self, evidence: Evidence) -> int:
        """Return the number of trials in a batch of ``batches``."""
        check_evidence(evidence)
        return self.batch_of(evidence.steps, evidence.step_ms)

    def batch_of(self, steps: int, step_ms: float) -> int:
        """Return the number of trials in a batch, for a number of steps of a length in ms."""
        if self.engine.rates:
            return BATCH
        samples = self.engine.samples(steps, step_ms)
        most = int(WIDE_NUMBERS / (samples * self.circuit.channels))
        return max(BATCH, min(WIDE_BATCH, most))

    def batches(
        self, evidence: Evidence, first_trial: int = 0
    ) -> Iterator[tuple[Evidence, Activity, Trace]]:
        """Run many trials in batches that fit into memory.

        Yields each batch of the evidence with its activity and its OUT. Results do not depend on
        the batches: trial t has the noise of ``first_trial + t``. Warnings and errors of
        ``check_strength`` refer to all of the evidence.
        """
        yield from self._checked(evidence)._parts(evidence, first_trial)

    def _parts(
        self, evidence: Evidence, first_trial: int
    ) -> Iterator[tuple[Evidence, Activity, Trace]]:
        batch = self.batch(evidence)
        for first in range(0, evidence.trials, batch):
            part = evidence[first : first + batch]
            with quiet(RangeWarning):  # not once per batch: ``warn_beyond_range`` warns once
                activity = self.run_drive(*self.driven(part), first_trial + first)
            yield part, activity, self.trace(activity, part)

    def one_trial(self, part: Evidence, first_trial: int, trial: int) -> tuple[Activity, Trace]:
        """Return the activity and OUT of one trial of a batch, identical to those in the batch."""
        ((_, activity, trace),) = self._parts(part[trial : trial + 1], first_trial + trial)
        return activity, trace


def drive_of(evidence: Evidence, gain: float = 1.0, max_deficit_nats: float = np.inf) -> Array:
    """Return the drive of a circuit that needs centred input, (trials, steps + 1, hypotheses) nats.

    It is ``Y_i - mean_j Y_j``, ``Y_i = max(gain L_i, max_j gain L_j - max_deficit_nats)``, with L
    the log prior (the first step alone) plus all readings so far: a common input cancels (Bogacz &
    Gurney 2007), and without the mean no rate has to be negative.
    """
    total = gain * evidence.totals
    total = np.maximum(total, total.max(axis=2, keepdims=True) - max_deficit_nats)
    return np.asarray(total - total.mean(axis=2, keepdims=True))
