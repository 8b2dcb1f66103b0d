"""Stop-signal trials: when the signal came, when a response was made, and the outcome."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
import pandas as pd

from bgmodel.deciding.decision import UNDECIDED, Decision
from bgmodel.support.checks import reals, whole
from bgmodel.support.saved import Facts, span
from bgmodel.support.seeds import generator
from bgmodel.trials.columns import EVERYONE, NO_RESPONSE
from bgmodel.trials.record import Trials
from circuits.arrays import Array, Truths
from circuits.errors import DataWarning, InputError, require

OUTCOMES = ("response", "omission", "failed stop", "successful stop")
"""Go trials with and without a response, then stop trials with and without one."""
FEWEST_TREND, TREND_ERRORS, TREND_MS = 20, 3.29, 10.0
"""Fewest go responses, standard errors (p = 0.001) and shift of the stop-signal reaction time that
a warning of a trend needs; of 1800 simulated people without a trend, one has it."""
TINY = 1e-12
"""Least variance."""
IN_SECONDS = 5.0
"""Delays below this, and above 0, look as if they were given in seconds, not in ms."""


@dataclass(frozen=True, repr=False)
class StopTrials(Facts):
    """Stop-signal trials of a person, an animal or a model, (trials,) ms from the go stimulus.

    ValueError for a negative or infinite time, without go trials, or for a signal after the
    deadline; warns of delays that look like seconds.
    """

    rt_ms: Array  # NaN without a response
    ssd_ms: Array  # NaN in go trials
    # In stop trials, wrong responses are failures to stop too.
    correct: Truths | None = None
    deadline_ms: float | None = None  # end of the longest trial; all signals come before it

    def __post_init__(self) -> None:
        for name in ("rt_ms", "ssd_ms"):
            values = np.asarray(reals(name, getattr(self, name)), dtype=np.float64)
            require(values.ndim == 1 and len(values), name, "must be (trials,)", values.shape)
            allowed = np.isnan(values) | (np.isfinite(values) & (values >= 0))
            must = "must be ms >= 0, or NaN for none"
            require(allowed.all(), name, must, values[~allowed][:1])
            object.__setattr__(self, name, values)
        same = len(self.rt_ms) == len(self.ssd_ms)
        require(same, "ssd_ms", f"must be one per trial, {len(self.rt_ms)}", len(self.ssd_ms))
        require((~self.stop).any(), "ssd_ms", "must be NaN in some trials, the go trials", "none")
        latest = np.nanmax(self.ssd_ms) if self.stop.any() else 0.0
        if self.deadline_ms is not None and latest >= self.deadline_ms:
            must = f"must be before the deadline, {self.deadline_ms:g} ms"
            raise InputError.of("ssd_ms", must, float(latest))
        _warn_of_seconds("ssd_ms", latest)

    def facts(self) -> dict[str, str]:
        """Return the numbers of trials, the delays and the proportion of failed stops."""
        stops = int(self.stop.sum())
        facts = {"trials": f"{len(self.rt_ms)}", "stop_trials": f"{stops}"}
        if stops:
            facts["ssd_ms"] = span(self.ssd_ms[self.stop])
            facts["p_respond"] = f"{self.p_respond:.3f}"
        return facts

    @property
    def stop(self) -> Truths:
        """Which trials have a stop signal, (trials,)."""
        return ~np.isnan(self.ssd_ms)

    @property
    def responded(self) -> Truths:
        """Which trials have a response, (trials,)."""
        return ~np.isnan(self.rt_ms)

    @property
    def p_respond(self) -> float:
        """Proportion of stop trials with a response."""
        return float(self.responded[self.stop].mean()) if self.stop.any() else float("nan")

    @property
    def outcome(self) -> npt.NDArray[np.str_]:
        """One of ``OUTCOMES`` per trial."""
        return np.asarray(np.take(OUTCOMES, 2 * self.stop.astype(int) + ~self.responded))

    @classmethod
    def of(cls, trials: Trials) -> StopTrials:
        """Return the stop-signal trials of one person's record, which has delays."""
        if trials.ssd_s is None:
            raise InputError("must have stop-signal delays", "ssd")
        known = trials.strength is not None or (trials.response == 0).any()
        correct = trials.correct == 1 if known else None
        end_ms = None if trials.deadline_s is None else 1000 * trials.deadline_s
        return cls(1000 * trials.rt_s, 1000 * trials.ssd_s, correct, end_ms)

    def without_trend(self) -> tuple[float, StopTrials]:
        """Return the slope of go times over trials, in standard errors, and trials without it.

        Neighbours are alike: errors are those of an autoregressive process. A go time and a delay
        move together, so that the race stays the same; all are later by one constant.
        """
        place = np.arange(len(self.rt_ms), dtype=np.float64)
        go = ~self.stop & self.responded
        if go.sum() < FEWEST_TREND:
            return 0.0, self
        x, y = place[go] - place[go].mean(), self.rt_ms[go]
        slope = float(x @ y / (x @ x))
        rest = y - y.mean() - slope * x
        alike = np.clip(rest[1:] @ rest[:-1] / max(rest @ rest, TINY), 0.0, 0.99)
        variance = (rest @ rest) / (len(y) - 2) / (x @ x) * (1 + alike) / (1 - alike)
        by_ms = slope * (place[-1] if slope > 0 else 0.0) - slope * place
        end_ms = None if self.deadline_ms is None else self.deadline_ms + by_ms.max()
        flat = replace(
            self, rt_ms=self.rt_ms + by_ms, ssd_ms=self.ssd_ms + by_ms, deadline_ms=end_ms
        )
        return slope / np.sqrt(max(variance, TINY)), flat

    def to_trials(self, who: str = EVERYONE) -> Trials:
        """Return them as the record of one person, in which response 1 is correct."""
        count = len(self.rt_ms)
        right = np.ones(count, bool) if self.correct is None else self.correct
        coded = np.where(self.responded, right, NO_RESPONSE).astype(np.int8)
        side = None if self.correct is None else np.ones(count)
        end_s = None if self.deadline_ms is None else self.deadline_ms / 1000
        blank = pd.DataFrame(index=range(count))
        return Trials(np.full(count, who), self.rt_ms / 1000, coded, side, blank, end_s,
                      ssd_s=self.ssd_ms / 1000)  # fmt: skip

    def to_dataframe(self) -> pd.DataFrame:
        """Return one row per trial as ``read_people`` reads it, with the outcome."""
        times = {"rt": self.rt_ms / 1000, "ssd": self.ssd_ms / 1000}
        table = pd.DataFrame(
            {"trial": np.arange(len(self.rt_ms)), **times, "outcome": self.outcome}
        )
        return table if self.correct is None else table.assign(correct=self.correct.astype(int))


def of_trend(trials: StopTrials, ssrt_ms: Callable[[StopTrials], float]) -> list[str]:
    """Return a warning if a trend of go times moves an estimate, which is a function of trials."""
    z, flat = trials.without_trend()
    if abs(z) < TREND_ERRORS:
        return []
    known_ms, flat_ms = ssrt_ms(trials), ssrt_ms(flat)
    if not abs(known_ms - flat_ms) > TREND_MS:
        return []
    return [
        f"go responses become {'slower' if z > 0 else 'faster'} from trial to trial ({abs(z):.1f} "
        "standard errors), by strategy or fatigue or because rows are sorted by time, while a race "
        "takes them to be alike: without this trend the stop-signal reaction time would be "
        f"{flat_ms:.0f} ms, not {known_ms:.0f}. Keep trials in the order of the session, and name "
        "each block as a separate participant (Verbruggen et al. 2013, 2019)"
    ]


def stop_trials(decision: Decision, ssd_ms: npt.ArrayLike, responses: int) -> StopTrials:
    """Return a model's decisions at one threshold as stop-signal trials.

    A choice from ``responses`` on, or none, withholds. ValueError for a signal after the end.
    """
    made = (decision.choice != UNDECIDED) & (decision.choice < responses)
    rt_ms = np.where(made, np.maximum(decision.time_ms, 0.0), np.nan)
    right = None if decision.truth is None else made & (decision.choice == decision.truth)
    trials = StopTrials(rt_ms, np.asarray(ssd_ms, float), right, float(decision.deadline_ms.max()))
    late = trials.ssd_ms >= decision.deadline_ms
    must = "must be before the deadline of the trial, or NaN"
    require(not late.any(), "ssd_ms", must, trials.ssd_ms[late][:1])
    return trials


def check_delays(delays_ms: npt.ArrayLike) -> Array:
    """Return a grid of delays, ms, as an array; ValueError unless all are numbers >= 0."""
    delays = np.atleast_1d(np.asarray(reals("delays_ms", delays_ms), dtype=np.float64))
    fits = delays.ndim == 1 and delays.size and np.isfinite(delays).all() and (delays >= 0).all()
    require(fits, "delays_ms", "must be numbers >= 0", delays_ms)
    _warn_of_seconds("delays_ms", float(delays.max()))
    return delays


def _warn_of_seconds(name: str, latest_ms: float) -> None:
    if 0 < latest_ms < IN_SECONDS:
        DataWarning.warn(f"{name} is at most {latest_ms:g}: delays are in ms, not in seconds")


def drawn_delays(
    trials: int, delays_ms: npt.ArrayLike, share: float, rng: np.random.Generator | int
) -> Array:
    """Draw stop-signal delays from a grid, ms, in a share of trials; NaN in the others."""
    delays, rng = check_delays(delays_ms), generator(rng)
    require(0 <= share <= 1, "share", "must be within 0..1", share)
    count = whole("trials", trials, 1)
    stop = rng.random(count) < share
    return np.where(stop, rng.choice(delays, count), np.nan)
