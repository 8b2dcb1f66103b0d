"""A circuit as an integrator beside ``Msprt``: the only module here that runs engines."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from types import NoneType
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from bgmodel.deciding.calibration import warn_of_decisions
from bgmodel.deciding.decision import (
    Decision,
    Trace,
    any_crossing,
    check_decision,
    first_crossing,
    joined,
)
from bgmodel.deciding.readout import ReadOut
from bgmodel.evidence import Evidence, check_evidence
from bgmodel.integrators.session import Reader, Session
from bgmodel.support.arrays import Array
from bgmodel.support.checks import check_flag, check_positive, whole
from bgmodel.support.memory import check_memory
from bgmodel.support.progress import advance
from bgmodel.support.reprs import Facts
from circuits.activity import RateMeans, beyond_range, checked_drive, warn_beyond_range
from circuits.anatomy import load_circuit as named
from circuits.circuit import Circuit
from circuits.engines import Algebra, EngineOrName
from circuits.errors import BgmodelWarning, EditWarning, InputError, NoiseWarning, RangeWarning
from circuits.ignored import ignored_edits

if TYPE_CHECKING:
    from circuits.activity import Activity

BATCH = 250
"""Trials that ``BasalGanglia.batches`` runs at a time."""
WIDE_BATCH, WIDE_NUMBERS = 2000, 4_000_000
"""Without rates: so many, if OUT has no more numbers than this. The rate engine is faster on many.
"""
ROUNDING_NATS = 0.01
"""How far below its threshold a trial is dropped."""
LEAD_MS = 100.0
"""Time per which a circuit states the largest lead that it follows, ms."""
REFUSED_TIMES = 8.0
"""A lead this many times the stated one is refused: a third of decisions come late by then."""
COARSE_MS, COARSE_SHARE = 5.0, 0.1
"""Samples of OUT further apart than both, ms and a share of the step, are warned of. With readings
every 50 ms the mean time is 5 ms longer at 5 ms, 13 at 10 ms and 58 at 50 ms."""
NOISE_SHARE = 0.02
"""Share of trials at rest that may cross a threshold within half a second, by noise."""


@dataclass(frozen=True, repr=False)
class BasalGanglia(Facts):
    """A basal ganglia circuit that integrates evidence; ``run`` gives OUT as ``Msprt`` does.

    Parameters
    ----------
    circuit : Circuit or str
        The table; or a name or a .toml file: that of 2 channels, or of as many as the file has.
    engine : Engine or str
        A record of ``circuits.engines`` with its options, as ``Population(dt_ms=0.5)``; or the name
        of one with its defaults. Population has the noise of spikes and is the fastest engine that
        has it.
    gain : float, optional
        Drive, in the circuit's unit, per nat of evidence, kappa: in nats OUT is then
        ``-ln softmax(kappa L)``. The circuit's default unless given; a circuit that states none
        needs one.
    seed : int, optional
        Key of the noise.
    centred : bool, optional
        Whether the mean over channels is taken off the evidence outside the circuit; as the table
        says unless given. True for a circuit that gets raw evidence is a control: what does it
        cost to cancel inside what channels have in common?

    Raises
    ------
    ValueError
        For an argument of the wrong kind or out of range.

    Warns
    -----
    UserWarning
        If the engine makes no use of a number of the circuit that was edited.
    """

    circuit: Circuit
    engine: EngineOrName = EngineOrName("population")
    gain: float = None  # type: ignore[assignment]  # a number once the model is made
    seed: int | None = 0
    centred: bool | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "circuit", checked_circuit(self.circuit))
        if self.gain is None:
            object.__setattr__(self, "gain", gain_of(self.circuit))
        check_positive(gain=self.gain)
        if self.seed is not None:
            whole("seed", self.seed, 0)
        if self.centred is not None:
            check_flag("centred", self.centred)
        self._warn_of_ignored_edits()

    def _warn_of_ignored_edits(self) -> None:
        """Warn if the engine makes no use of a number that was edited."""
        if ignored := ignored_edits(self.circuit, self.engine):
            EditWarning.warn(
                f"the {self.engine} engine makes no use of these edits of {self.circuit.name}: "
                f"{'; '.join(ignored)}; take another engine, or leave them out"
            )

    def facts(self) -> dict[str, str]:
        """Return the circuit, its engine, its gain and its noise."""
        found = {
            "circuit": self.circuit.name,
            "channels": f"{self.circuit.channels}",
            "engine": self.engine.id,
            "gain": f"{self.gain:g}",
            "seed": f"{self.seed}",
        }
        if self.centred is not None:
            found["centred"] = f"{self.centred}"
        return found | {name: f"{value}" for name, value in self.engine.changed().items()}

    def run(self, evidence: Evidence) -> Trace:
        """Return OUT (trials, ticks, hypotheses) in kappa-nats, from the onset of evidence.

        Readings come at ``onset_ms + k step_ms``; each is held, and the last one for a step more,
        so that the circuit can answer it. A foreperiod in which something is expected is run too.
        """
        return self.trace(self.activity(evidence), evidence)

    def drive(self, evidence: Evidence) -> Array:
        """Return the drive: raw evidence, or as ``drive_of`` where it is centred.

        Raises
        ------
        ValueError
            If each channel gets its own evidence and that has no baseline, or if something is
            expected where the mean over channels is taken off.
        """
        expected = check_evidence(evidence).expectancy_nats
        if not self.raw:
            if expected is not None:
                raise InputError(
                    "what is expected is common to all channels, and their mean is taken off what "
                    f"{self.circuit.name} gets: nothing of it would arrive",
                    "evidence",
                )
            return drive_of(evidence, self.gain, self.circuit.max_deficit_nats)
        totals = evidence.own_totals
        if expected is not None:
            before = totals[:, :1] + expected[:, :, None]
            totals = np.concatenate([before, totals + expected[:, -1:, None]], axis=1)
        return self.gain * totals

    @property
    def raw(self) -> bool:
        """Whether each channel gets its own evidence, and no mean is taken off before."""
        return not (self.circuit.centred if self.centred is None else self.centred)

    def trace(self, activity: Activity, evidence: Evidence) -> Trace:
        """Return the OUT of an activity as a trace on the evidence's clock.

        A trial ends a step after its last reading, as it would if no other were longer.
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
        """Let the circuit decide, with every check and warning of ``bgmodel circuit run``.

        It goes through the trials a part at a time; where the engine can, a trial is over at its
        decision.

        Parameters
        ----------
        evidence : Evidence
            What it is given.
        threshold : float, optional
            OUT at which it decides, in the circuit's unit.
        posterior : float, optional
            Posterior at which it decides, in the circuit's nats, in place of a threshold.
        forced : bool
            Whether the deadline forces a response.
        rates : RateMeans, optional
            Filled with the rates of all trials, which run to their ends then.

        Raises
        ------
        ValueError
            If the circuit would decide without evidence at that threshold, or does not read it.

        Warns
        -----
        UserWarning
            If the evidence leaves the circuit's range, noise alone crosses the threshold, most
            trials are decided by the deadline or before their first reading, or posteriors at the
            decision are not the share of right choices.
        """
        if not isinstance(rates, (RateMeans, NoneType)):
            raise InputError.of("rates", "must be a RateMeans() of circuits.activity", rates)
        check_flag("forced", forced)
        level = self.threshold(threshold, posterior)
        self.warn_beyond_range(evidence)
        self.warn_of_noise(level)
        decision = self.decided(evidence, level, forced=forced, rates=rates)
        check_decision(decision, level, forced=forced, of_test=False)
        warn_of_decisions(evidence, decision)
        return decision

    def decided(
        self,
        evidence: Evidence,
        level: float,
        *,
        forced: bool = True,
        rates: RateMeans | None = None,
    ) -> Decision:
        """Return the decisions at one output level, without the checks of ``decide``.

        It is for those that check and warn themselves, such as experiments.
        """
        model = self.until(level - ROUNDING_NATS) if rates is None else self
        parts = []
        for part, activity, trace in model.batches(evidence):
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
        """Return a session that decides as readings come; options as of ``Session``.

        Raises
        ------
        ValueError
            As ``decide``; if the engine takes all readings of a trial at once; if each channel gets
            its own evidence and there is no baseline.

        Warns
        -----
        UserWarning
            Once, if a reading leaves the circuit's range; if noise alone crosses the threshold. How
            strong evidence is on the mean is not known before its readings: see ``check_strength``.
        """
        level = self.threshold(threshold, posterior)
        self.warn_of_noise(level)
        nothing = np.zeros((1, 1, self.circuit.channels))
        empty = Evidence(nothing, prior=prior, step_ms=step_ms, baseline=baseline)  # type: ignore[arg-type]

        doubts: list[str] = []  # said once a session, not at every reading

        def begin(trial: int) -> Reader:
            stream = self.engine.stream(
                self.circuit, step_ms=step_ms, steps=t_max + 1, seed=self.seed, trial=trial
            )
            stream.add(self.drive(empty)[0, 0])

            def read(evidence: Evidence) -> Trace:
                drive = self.drive(evidence)[:, -1:]
                if not doubts and (said := beyond_range(self.circuit, drive)):
                    doubts.append(said)
                    RangeWarning.warn(said)
                stream.add(drive[0, 0])
                known, numbers = readout_of(self.circuit), evidence.trial_numbers
                out = stream.out[None, : stream.samples]
                return Trace(out, stream.time_ms, 0.0, step_ms, None, numbers, known)

            return read

        return Session(
            begin, self.circuit.channels, level, step_ms=step_ms, t_max=t_max, prior=prior,
            baseline=baseline, forced=forced, first_trial=first_trial,
        )  # fmt: skip

    def threshold(self, threshold: float | None, posterior: float | None) -> float:
        """Return the OUT at which the circuit decides, given as one or as a posterior; checked."""
        return readout_of(self.circuit).one(threshold, posterior, self.circuit.channels)

    def activity(self, evidence: Evidence, first_trial: int = 0) -> Activity:
        """Return all that the circuit did; trial t has the noise of ``first_trial + t``.

        Warns of evidence that is stronger than the circuit follows; see ``check_strength``.
        """
        self.check_strength(evidence)
        self._warn_of_coarse_samples(evidence)
        return self.run_drive(self.drive(evidence), evidence.step_ms, first_trial)

    def run_drive(self, drive: npt.ArrayLike, step_ms: float, first_trial: int = 0) -> Activity:
        """Return what the circuit does under a drive (trials, steps, channels) in its own nats."""
        trials, steps, _ = checked_drive(self.circuit, drive).shape
        self.check_memory(trials, steps, step_ms)
        return self.engine.run(
            self.circuit, drive, step_ms=step_ms, seed=self.seed, first_trial=first_trial
        )

    def check_memory(self, trials: int, steps: int, step_ms: float) -> None:
        """Raise ValueError if there is no memory for so many trials at a time."""
        check_memory(
            self._memory_bytes(trials, steps, step_ms),
            f"{trials} trials of {self.circuit.name}, engine {self.engine},",
        )

    def memory_gb(self, trials: int, steps: int, step_ms: float) -> float:
        """Return about how much memory so many trials at a time take, GB."""
        return self._memory_bytes(trials, steps, step_ms) / 1e9

    def _memory_bytes(self, trials: int, steps: int, step_ms: float) -> float:
        samples = self.engine.samples(steps, step_ms)
        return self.engine.memory_bytes(self.circuit, trials, samples)

    def warn_beyond_range(self, evidence: Evidence) -> None:
        """Warn if the evidence leaves the range in which the circuit works."""
        warn_beyond_range(self.circuit, self.drive(evidence))

    def lead_nats(self, evidence: Evidence) -> float:
        """Return the mean lead that the best-supported channel gains, nats of drive.

        The lead is over the mean of the other channels at a trial's end, per 100 ms, or per reading
        where readings are further apart.
        """
        total = evidence.log_likelihood.sum(axis=1, dtype=np.float64)
        most = total.max(axis=1)
        others = (total.sum(axis=1) - most) / (evidence.hypotheses - 1)
        per_reading = self.gain * float((most - others).sum()) / int(evidence.readings.sum())
        return per_reading * max(1.0, LEAD_MS / evidence.step_ms)

    def check_strength(self, evidence: Evidence) -> None:
        """Warn if evidence is stronger than the circuit follows.

        An engine in which no time passes follows any evidence.

        Raises
        ------
        ValueError
            If the evidence gains ``REFUSED_TIMES`` the lead that the circuit states, or more, or
            it is no ``Evidence``.
        """
        check_evidence(evidence)
        most = self.circuit.max_lead_nats
        if not (self.engine.timed and np.isfinite(most)):
            return
        lead = self.lead_nats(evidence)
        # A hypothesis that is ruled out has no finite nats: the engines refuse it.
        if lead <= most or not np.isfinite(lead):
            return
        said = (
            f"the evidence is too strong for {self.circuit.name}: one channel gains a lead of "
            f"{lead:.3g} nats of drive per {max(LEAD_MS, evidence.step_ms):g} ms, the circuit "
            f"follows up to {most:.3g}, and beyond that decisions come late or never"
        )
        if lead >= REFUSED_TIMES * most:
            raise InputError(f"{said}; lower the gain or give weaker evidence", "evidence")
        RangeWarning.warn(said)

    def _warn_of_coarse_samples(self, evidence: Evidence) -> None:
        """Warn if OUT is sampled so rarely that decision times come out too long."""
        sample_ms = self.engine.sample_ms
        most = max(COARSE_MS, COARSE_SHARE * evidence.step_ms)
        if sample_ms > most:
            BgmodelWarning.warn(
                f"sample_ms = {sample_ms:g}: a decision is made only at a sample of OUT, so that "
                f"decision times come out too long; give {most:g} or less"
            )

    def out_at_rest(self, trials: int = 40) -> Array:
        """Return OUT (trials, ticks, channels) of 500 ms without evidence, with noise."""
        silence = np.zeros((trials, 1, self.circuit.channels))
        quiet = replace(self, engine=self.engine.at_rest())
        return np.asarray(quiet.run_drive(silence, step_ms=500.0).output_nats)

    def warn_of_noise(self, threshold_nats: float) -> None:
        """Warn if noise alone crosses a threshold."""
        if not (self.engine.noisy and self.engine.threaded):
            return
        out = self.out_at_rest()
        share = any_crossing(out, threshold_nats).mean()
        if share > NOISE_SHARE:
            NoiseWarning.warn(
                f"without evidence noise takes OUT below the threshold of {threshold_nats:.2f} "
                f"nats in {share:.0%} of trials within 500 ms: OUT rests at {out.mean():.2f} +- "
                f"{out.std():.2f}"
            )

    def until(self, level_nats: float, *, rates: bool = False) -> BasalGanglia:
        """Return the model that drops a trial below a level of OUT, where its engine can."""
        return replace(self, engine=self.engine.until(level_nats, rates=rates))

    def batch(self, evidence: Evidence) -> int:
        """Return the number of trials in a batch of ``batches``."""
        check_evidence(evidence)
        if self.engine.rates:
            return BATCH
        samples = self.engine.samples(evidence.steps, evidence.step_ms)
        most = int(WIDE_NUMBERS / (samples * evidence.hypotheses))
        return max(BATCH, min(WIDE_BATCH, most))

    def batches(
        self, evidence: Evidence, first_trial: int = 0
    ) -> Iterator[tuple[Evidence, Activity, Trace]]:
        """Go through many trials, a part that fits into memory at a time.

        Yields each part of the evidence with its activity and its OUT; what a trial does is the
        same in any part, and trial t has the noise of ``first_trial + t``. Warnings and errors of
        ``check_strength`` are about all of the evidence.
        """
        self.check_strength(evidence)
        self._warn_of_coarse_samples(evidence)
        yield from self._parts(evidence, first_trial)

    def _parts(
        self, evidence: Evidence, first_trial: int
    ) -> Iterator[tuple[Evidence, Activity, Trace]]:
        batch = self.batch(evidence)
        for first in range(0, evidence.trials, batch):
            part = evidence[first : first + batch]
            with warnings.catch_warnings():
                # A part at a time it would be said many times: ``warn_beyond_range`` says it once.
                warnings.simplefilter("ignore", RangeWarning)
                activity = self.run_drive(self.drive(part), part.step_ms, first_trial + first)
            yield part, activity, self.trace(activity, part)

    def one_trial(self, part: Evidence, first_trial: int, trial: int) -> tuple[Activity, Trace]:
        """Return the activity and OUT of one trial of a part, the same as within that part."""
        ((_, activity, trace),) = self._parts(part[trial : trial + 1], first_trial + trial)
        return activity, trace


def checked_circuit(given: Circuit | str | Path, channels: int | None = None) -> Circuit:
    """Return a circuit: itself, or the table of a name or of a .toml file.

    Parameters
    ----------
    given : Circuit, str or path
        What a user gives.
    channels : int, optional
        Number of alternatives, where it is not a circuit yet.

    Raises
    ------
    ValueError
        For an unknown name, and for anything else.
    """
    if isinstance(given, Circuit):
        return given
    if isinstance(given, (str, Path)):
        return named(given, channels)
    hint = ": give its .circuit" if isinstance(given, BasalGanglia) else ""
    raise InputError(
        f"circuit must be a Circuit, a name or a .toml file, got {type(given).__name__}{hint}",
        "circuit",
    )


def gain_of(circuit: Circuit, given: float | None = None) -> float:
    """Return the gain that is given, or else the circuit's default, 1 for an exact circuit.

    Parameters
    ----------
    circuit : Circuit
        The table.
    given : float, optional
        A gain that was asked for.

    Raises
    ------
    ValueError
        If none is given and the circuit has no default: that of another table would mean nothing.
    """
    found = circuit.default_gain if given is None else given
    if found is None and (circuit.unedited or circuit).exact:
        return 1.0  # an exact table follows -ln P at any gain
    if found is None:
        raise InputError(
            f"{circuit.name} has no default gain: give gain=... (at the terminal --gain), the "
            f"circuit's {circuit.unit} per nat of evidence",
            "gain",
        )
    return found


def identity(circuit: Circuit) -> dict[str, str]:
    """Return the name and the hash of a circuit, as edited: for provenance."""
    from circuits.declaration.table_files import digest

    return {"name": circuit.name, "sha256": digest(circuit)}


def rest_out(circuit: Circuit) -> float:
    """Return the lowest OUT at the fixed point of rest; infinity where there is none.

    Courses begin with the drive: before it there is none.
    """
    try:
        silence = np.zeros((1, 1, circuit.channels))
        found = Algebra().run(circuit.steady, silence, step_ms=1.0).output_nats.min()
    except ValueError:
        return np.inf  # Without a state of rest there is nothing to compare with.
    return float(found)


def check_threshold(circuit: Circuit, threshold_nats: float) -> None:
    """Refuse a threshold that the circuit is past before any evidence, or never reads.

    Parameters
    ----------
    circuit : Circuit
        The table.
    threshold_nats : float
        OUT at which it decides, in the circuit's unit.

    Raises
    ------
    ValueError
        With the OUT at rest.
    """
    readout_of(circuit).check(threshold_nats)


@lru_cache(maxsize=1024)
def readout_of(circuit: Circuit) -> ReadOut:
    """Return what thresholds on a circuit's OUT can mean: where it rests, and what it reads."""
    return ReadOut(circuit.name, circuit.readable_nats[0], rest_out(circuit), circuit.unit)


def check_conditions(
    control: Circuit, control_nats: float, manipulated: Circuit, manipulated_nats: float
) -> None:
    """Refuse the thresholds of a control and a manipulation, as ``check_threshold`` does.

    A manipulated circuit that rests below its threshold is an outcome: it decides without evidence.
    What its read-out tells apart is none.

    Parameters
    ----------
    control, manipulated : Circuit
        The circuit before and after a manipulation.
    control_nats, manipulated_nats : float
        OUT at which each decides.

    Raises
    ------
    ValueError
        If the control would decide without evidence, or either circuit never reads its threshold.
    """
    check_threshold(control, control_nats)
    if manipulated_nats < manipulated.readable_nats[0]:
        check_threshold(manipulated, manipulated_nats)


def deciding_thresholds(circuit: Circuit, thresholds_nats: Array) -> Array:
    """Return those thresholds that lie below OUT at rest, and that the read-out can reach."""
    low = circuit.readable_nats[0]
    return thresholds_nats[(thresholds_nats >= low) & (thresholds_nats < rest_out(circuit))]


def drive_of(evidence: Evidence, gain: float = 1.0, max_deficit_nats: float = np.inf) -> Array:
    """Return the drive of a circuit that needs it centred, (trials, steps + 1, hypotheses) nats.

    Parameters
    ----------
    evidence : Evidence
        Readings; before the first there is the prior alone.
    gain : float
        kappa.
    max_deficit_nats : float
        No drive falls further than this below the leader's.

    Notes
    -----
    ``Y_i - mean_j Y_j``, ``Y_i = max(kappa L_i, max_j kappa L_j - reach)``, with L the log prior
    plus all readings so far: a common input changes nothing (Bogacz & Gurney 2007), and without
    the mean no rate would have to be negative.
    """
    total = gain * evidence.totals
    total = np.maximum(total, total.max(axis=2, keepdims=True) - max_deficit_nats)
    return np.asarray(total - total.mean(axis=2, keepdims=True))
