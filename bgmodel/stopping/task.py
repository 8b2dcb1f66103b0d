"""The stop-signal task: how stop signals are added to the trials of any task, and staircases.

The delay then settles where half of the stop trials have a response, whatever makes the responses,
which is where the consensus guide estimates best (Verbruggen et al. 2019). The outcome of every
trial at every delay is given as a table, so a staircase walks through the trials of a race, an
observer or a circuit alike, and the same trials can be walked through from several starts.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
import numpy.typing as npt

from bgmodel.deciding.decision import Decision
from bgmodel.deciding.measures import unforced
from bgmodel.evidence import Evidence, check_evidence
from bgmodel.stopping.inputs import StopSignal, receiving, with_onsets
from bgmodel.stopping.trials import StopTrials, check_delays, stop_trials
from bgmodel.support import toml_files
from bgmodel.support.checks import check_range, reals, whole
from bgmodel.support.seeds import stream
from circuits.arrays import Array, Integers, Truths
from circuits.errors import DataWarning, InputError, require

if TYPE_CHECKING:
    from bgmodel.integrators.basal_ganglia import BasalGanglia


def walk(responded: npt.ArrayLike, delays_ms: npt.ArrayLike, starts_ms: npt.ArrayLike) -> Integers:
    """Return the delay of each stop trial, an index (trials,), under interleaved staircases.

    ``responded`` (delays, trials) are the outcomes at each delay; trial k belongs to staircase k
    modulo their number. Warns if one never reverses: it then estimates nothing.
    """
    table, delays, starts = _checked(responded, delays_ms, starts_ms)
    index = np.empty(table.shape[1], dtype=np.int64)
    for which, start in enumerate(starts):
        at = int(np.flatnonzero(delays == start)[0])
        of_staircase = np.arange(which, table.shape[1], len(starts))
        for trial in of_staircase:
            index[trial] = at
            at = min(max(at + (-1 if table[at, trial] else 1), 0), len(delays) - 1)
        _warn_unless_it_reverses(float(start), table[index[of_staircase], of_staircase])
    return index


def _checked(
    responded: npt.ArrayLike, delays_ms: npt.ArrayLike, starts_ms: npt.ArrayLike
) -> tuple[Truths, Array, Array]:
    table = np.asarray(responded)
    delays = np.asarray(reals("delays_ms", delays_ms), dtype=np.float64)
    starts = np.atleast_1d(np.asarray(reals("starts_ms", starts_ms), dtype=np.float64))
    rising = delays.ndim == 1 and delays.size > 1 and (np.diff(delays) > 0).all()
    valid = rising and delays[0] >= 0 and np.isfinite(delays).all()
    require(valid, "delays_ms", "must be two or more increasing numbers >= 0", delays)
    must = f"must be True or False for each of {len(delays)} delays and each trial"
    fits = table.dtype == np.bool_ and table.ndim == 2 and len(table) == len(delays)
    require(fits, "responded", must, table)
    known = starts.ndim == 1 and starts.size and np.isin(starts, delays).all()
    require(known, "starts_ms", f"must be among the delays, {delays[0]:g} to {delays[-1]:g} ms in "
            "the given steps", starts)  # fmt: skip
    must = f"must be at most one per stop trial, {table.shape[1]}"
    require(starts.size <= table.shape[1], "starts_ms", must, starts)
    return table, delays, starts


def _warn_unless_it_reverses(start_ms: float, failed: Truths) -> None:
    if failed.all() or not failed.any():
        kind = "failed" if failed.all() else "successful"
        DataWarning.warn(
            f"the staircase that starts at {start_ms:g} ms never reverses: all of its "
            f"{len(failed)} stop trials are {kind} stops; change its start, its range or the model"
        )


STREAM = "stop signals"
"""Name of the random-number stream of stop trials, delays and trigger failures."""


@dataclass(frozen=True)
class StopTask(StopSignal):
    """Stop signals in a share of a task's trials, and how they reach the circuit.

    Response times are those of decisions. A motor delay would add to go times and to the
    stop-signal reaction time alike.

    Raises
    ------
    ValueError
        For a number out of range, no delays, or, with staircases, fewer than two.

    Warns
    -----
    UserWarning
        If delays look like seconds, or as for ``StopSignal``.
    """

    __pydantic_config__: ClassVar[dict[str, Any]] = toml_files.STRICT

    share: float = 0.25
    """Probability of a stop signal, between 0 and 1."""
    delays_ms: tuple[float, ...] = (100.0, 150.0, 200.0, 250.0, 300.0, 350.0, 400.0, 450.0, 500.0)
    """Stop-signal delays from the onset of evidence, ms: each is equally likely, or, with
    staircases, a step of them."""
    staircases: int = 0
    """Number of interleaved staircases: a delay is followed by the next longer one after a
    successful stop, by the next shorter one after a failed stop. 0 draws delays at random."""
    delay_sd_ms: float = 0.0
    """Standard deviation of the delay from the signal to the nucleus, ms; no delay is below 0. A
    cancel comes earlier or later by the same time."""
    failures: float = 0.0
    """Probability that a signal triggers nothing, 0..1."""

    def __post_init__(self) -> None:
        super().__post_init__()
        require(0 < self.share < 1, "share", "must be between 0 and 1", self.share)
        check_range(0, 1, failures=self.failures)
        check_range(0, np.inf, delay_sd_ms=self.delay_sd_ms)
        whole("staircases", self.staircases, 0)
        delays = check_delays(self.delays_ms)
        if self.staircases and (len(delays) < 2 or not (np.diff(delays) > 0).all()):
            must = "must be two rising numbers or more with staircases"
            raise InputError.of("delays_ms", must, self.delays_ms)

    def used(self) -> dict[str, Any]:
        """Return the settings by name, for provenance; infinite times are left out."""
        return {
            name: value
            for name, value in vars(self).items()
            if not (isinstance(value, float) and np.isinf(value))
        }

    def check_ends(self, end_ms: float) -> None:
        """Raise ValueError if a signal would come after the end of the shortest trial, ms."""
        must = f"must be before the deadline of every trial, {end_ms:g} ms"
        require(max(self.delays_ms) < end_ms, "delays_ms", must, max(self.delays_ms))

    def decide(
        self,
        model: BasalGanglia,
        evidence: Evidence,
        *,
        threshold: float | None = None,
        posterior: float | None = None,
        seed: int = 0,
    ) -> StopTrials:
        """Let a circuit decide with stop signals in a share of the trials, as `circuit run --stop`.

        Parameters
        ----------
        model : BasalGanglia
            The circuit, its engine and its noise.
        evidence : Evidence
            Readings of all trials.
        threshold, posterior : float
            When it decides: one of them, as for ``BasalGanglia.decide``.
        seed : int
            Seed of the stop trials, their delays and trigger failures.

        Returns
        -------
        StopTrials
            Its response times and delays.

        Raises
        ------
        ValueError
            If a delay comes after the end of a trial, common input is cancelled at the nucleus, or
            as for ``BasalGanglia.threshold``.

        Warns
        -----
        UserWarning
            If the evidence leaves the circuit's range, noise alone crosses the threshold, or a
            staircase never reverses.
        """
        from bgmodel.integrators.basal_ganglia import BasalGanglia

        require(isinstance(model, BasalGanglia), "model", "must be a BasalGanglia", model)
        check_evidence(evidence)
        level = model.threshold(threshold, posterior)
        model.warn_beyond_range(evidence)
        model.warn_of_noise(level)
        decision, ssd = decided(self, model, evidence, level, stream(seed, STREAM))
        return stop_trials(unforced(decision), ssd, evidence.hypotheses)


def decided(
    task: StopTask, model: BasalGanglia, evidence: Evidence, level: float, rng: np.random.Generator
) -> tuple[Decision, Array]:
    """Return a circuit's decisions, forced by deadlines, and delays, ms, NaN in go trials."""
    task.check_ends(evidence.step_ms * int(evidence.readings.min()))
    model = receiving(model, task).adapted_to(evidence)
    stop = rng.random(evidence.trials) < task.share
    late = np.maximum(task.delay_sd_ms * rng.standard_normal(len(stop)), -task.delay_ms)
    late[rng.random(len(stop)) < task.failures] = np.nan

    def at(ssd_ms: Array) -> Decision:
        with_signal = with_onsets(evidence, task.onsets(ssd_ms) + late, task)
        return model.decided(with_signal, level)

    delays = np.asarray(task.delays_ms, float)
    if not task.staircases:
        ssd = np.where(stop, rng.choice(delays, len(stop)), np.nan)
        return at(ssd), ssd
    each = [at(np.where(stop, delay, np.nan)) for delay in delays]
    place = np.zeros(len(stop), int)
    responded = np.stack([~one.forced[stop] for one in each])
    # The first delays of staircases are spread evenly.
    inner = np.linspace(0, len(delays) - 1, task.staircases + 2)[1:-1]
    place[stop] = walk(responded, delays, delays[[round(each) for each in inner]])
    names = ("choice", "time_ms", "forced", "premature", "deadline_ms")
    trial = np.arange(len(place))
    columns = {n: np.stack([getattr(one, n) for one in each])[place, trial] for n in names}
    return replace(each[0], **columns), np.where(stop, delays[place], np.nan)
