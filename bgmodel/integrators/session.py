"""Online decisions: readings are added one by one until the model decides."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from bgmodel.deciding.decision import UNDECIDED, Decision, first_crossing
from bgmodel.deciding.trace import Trace
from bgmodel.evidence import Evidence
from bgmodel.plausibility import are_sums, products
from bgmodel.support.checks import is_number, reals, whole
from circuits.arrays import Array
from circuits.errors import (
    DataWarning,
    DeadlineWarning,
    InputError,
    NoiseWarning,
    quiet,
)

SHORT = 4
"""Trials with fewer readings before the decision are not examined for running sums."""

Reader = Callable[[Evidence], Trace]
"""Maps all readings of a trial so far to OUT, up to a step after the last one."""


class Session:
    """Trials whose readings are added as they come; made by the ``session`` method of a model.

    Each trial gives the same OUT, choice and time, to the byte, as ``decide`` with all readings at
    once. A reading is held for a step, so a circuit may decide between two readings. No state is
    kept from one trial to the next; they are numbered from ``first_trial``, which sets their noise.
    A trial ends after ``t_max`` steps, with a response if ``forced``. A ``baseline`` is needed if
    each channel gets its own evidence.

    Readings are added up here: give each reading alone, not the sum so far. Sums are decided much
    too early and are wrong more often. Once trials of five readings or more add up to a hundred
    readings, a warning is given if successive readings correlate as sums do. Sums that are decided
    within fewer readings cannot be distinguished from strong evidence.

    Examples
    --------
    >>> import bgmodel as bg
    >>> session = bg.Msprt().session(2, posterior=0.9)
    >>> session.add([0.0, -1.0])
    >>> session.add([0.0, -1.5]).choice[0]
    np.int64(0)
    """

    def __init__(
        self,
        begin: Callable[[int], Reader],
        hypotheses: int,
        threshold: float,
        *,
        step_ms: float,
        t_max: int,
        prior: npt.ArrayLike | None = None,
        baseline: float | None = None,
        forced: bool = True,
        first_trial: int = 0,
    ) -> None:
        self.hypotheses, self.threshold, self.forced = hypotheses, threshold, forced
        self.t_max = whole("t_max", t_max, 1)
        self.trial = whole("first_trial", first_trial, 0) - 1
        # Input of a step without a reading: uninformative, also if each channel has its own.
        self._nothing = np.full(hypotheses, baseline or 0.0)
        self._empty = Evidence(
            self._nothing[None, None], prior=prior, step_ms=step_ms, baseline=baseline,  # type: ignore[arg-type]
        )  # fmt: skip
        self._begin, self._premature = begin, False
        self._products, self._summed = np.zeros(3), False
        self.next()

    def next(self) -> None:
        """Begin the next trial, at rest."""
        self.trial += 1
        self.readings: list[Array] = []
        self.decision: Decision | None = None
        self.trace: Trace | None = None
        self._read = self._begin(self.trial)

    def add(self, reading: npt.ArrayLike, *, at_ms: float | None = None) -> Decision | None:
        """Add a reading, nats; return the decision of this one trial, or None while undecided.

        ``at_ms`` is its time from the onset of evidence, by default a step after the last one;
        steps in between pass without a reading. Warns if it comes more than half a step late and,
        once, if the readings so far look like running sums. A trial that is decided raises.
        """
        if self.decision is not None:
            raise InputError("this trial is decided: session.next() begins another one", "reading")
        nats = np.asarray(reals("reading", reading), dtype=np.float64)
        if nats.shape != (self.hypotheses,) or not np.isfinite(nats).all():
            raise InputError.of(
                "reading", f"must be {self.hypotheses} finite log-likelihoods", reading
            )
        for _ in range(self._late(at_ms)):
            if self._take(self._nothing) is not None:
                return self.decision
        return self._take(nats)

    def _late(self, at_ms: float | None) -> int:
        """Return how many steps passed without a reading."""
        step_ms, due = self._empty.step_ms, len(self.readings) + 1
        if at_ms is None:
            return 0
        if not (is_number(at_ms) and math.isfinite(at_ms)):
            raise InputError.of("at_ms", "must be a finite time", at_ms)
        if at_ms < (due - 1) * step_ms:
            raise InputError(
                f"readings must come in order: the last one was at {(due - 1) * step_ms:g} ms, "
                f"this one is of {at_ms:g}",
                "at_ms",
            )
        late = math.floor(at_ms / step_ms - due + 0.5)
        if late > 0:
            DeadlineWarning.warn(
                f"reading {due} came {at_ms - due * step_ms:.0f} ms late: {late} steps passed "
                "without one"
            )
        return max(late, 0)

    def _take(self, reading: Array) -> Decision | None:
        """Advance one step; the last step is the deadline."""
        self.readings.append(reading)
        evidence = self._evidence()
        self.trace = self._read(evidence)
        decision = self._crossed(forced=False)
        if decision.choice[0] != UNDECIDED:
            self._end(decision)
            if decision.premature[0] and not self._premature:
                self._premature = True
                NoiseWarning.warn(
                    "a trial was decided before its first reading could act: by noise or the prior"
                )
        elif len(self.readings) == self.t_max:
            self.finish()
        return self.decision

    def _end(self, decision: Decision) -> None:
        """End the trial with its decision; warn once if readings look like running sums."""
        self.decision = decision
        # The last reading is left out: it is the one that crossed, and so larger than others.
        readings = np.array(self.readings[:-1])
        if len(readings) >= SHORT:
            self._products += products(readings)
        if are_sums(self._products) and not self._summed:
            self._summed = True
            DataWarning.warn(
                "successive readings of a trial correlate as running sums do: give the "
                "log-likelihoods of each reading alone, since a session adds them up"
            )

    def _evidence(self) -> Evidence:
        values = np.array(self.readings)[None]
        # Evidence warns about the look of its values; that is meant for whole tables.
        with quiet(DataWarning):
            return replace(self._empty, log_likelihood=values, numbers=np.array([self.trial]))

    def _crossed(self, forced: bool) -> Decision:
        assert self.trace is not None
        return first_crossing(self.trace, self.threshold, forced=forced, checked=False)

    def finish(self) -> Decision:
        """End the trial: return its decision, or that made at the deadline."""
        if self.trace is None:
            raise InputError("a trial without a reading cannot end", "reading")
        if self.decision is None:
            self._end(self._crossed(self.forced))
        assert self.decision is not None
        return self.decision
