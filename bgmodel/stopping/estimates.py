"""Estimates of the stop-signal reaction time, after the consensus guide (Verbruggen et al. 2019).

The guide's recommendation is the integration method with omissions replaced: go trials without a
response count as the slowest. The mean method is included for comparison. ``draw`` shows them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from bgmodel.deciding.measures import P_RANGE
from bgmodel.plots import wilson
from bgmodel.stopping.trials import StopTrials, of_trend
from bgmodel.support.saved import Facts
from bgmodel.support.tables import Readable
from circuits.arrays import Array
from circuits.errors import DataWarning, InputError, quiet
from circuits.plots import GREY, PALETTE, Look, panels, styled

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from bgmodel.stopping.task import StopTask

FEWEST_STOPS = 50
"""Number of stop trials below which the guide calls estimates unreliable."""


@dataclass(frozen=True, repr=False)
class StopEstimate(Facts):
    """Estimates from the stop-signal trials of one participant."""

    ssrt_ms: float  # integration method with omissions replaced
    ssrt_mean_ms: float  # mean go time minus mean delay; biased (Verbruggen et al.)
    p_respond: float  # on stop trials
    go_ms: float  # mean response time on go trials
    failed_ms: float  # mean response time on stop trials
    ssd_ms: float  # mean stop-signal delay
    omissions: float  # proportion of go trials without a response
    refusal: str = ""  # why the consensus guide rejects the estimate; empty if not

    @property
    def failed_minus_go_ms(self) -> float:
        """Mean failed stop minus mean go time: negative if go and stop race independently."""
        return self.failed_ms - self.go_ms

    def facts(self) -> dict[str, str]:
        """Return the main estimates, and the refusal if there is one."""
        estimates = {
            name: f"{getattr(self, name):.3g}"
            for name in ("ssrt_ms", "p_respond", "go_ms", "failed_ms", "ssd_ms", "omissions")
        }
        return estimates | ({"refusal": self.refusal} if self.refusal else {})


def estimate_ssrt(trials: StopTrials, *, checked: bool = True) -> StopEstimate:
    """Return the stop-signal reaction time of one participant; warn of few stop trials, a trend.

    If ``checked``, raises where the guide accepts no estimate: responses outside 0.25 to 0.75, or
    failed stops slower than go responses.
    """
    estimate = estimated(trials, checked=checked)
    for text in (*of_few(trials), *of_trend(trials, integrated)):
        DataWarning.warn(text)
    return estimate


def estimated(trials: StopTrials, *, checked: bool) -> StopEstimate:
    """Return the estimate of ``estimate_ssrt`` without warnings."""
    if not trials.stop.any():
        raise InputError.of("ssd_ms", "must have stop trials", "none")
    go = trials.rt_ms[~trials.stop]
    responses = go[~np.isnan(go)]
    if not len(responses):
        raise InputError.of("rt_ms", "must have responses on go trials", "none")
    failed = trials.rt_ms[trials.stop & trials.responded]
    ssd_ms, p = float(trials.ssd_ms[trials.stop].mean()), trials.p_respond
    estimates = {
        "ssrt_ms": integrated(trials),
        "ssrt_mean_ms": float(responses.mean()) - ssd_ms,
        "p_respond": p,
        "go_ms": float(responses.mean()),
        "failed_ms": float(failed.mean()) if len(failed) else np.nan,
        "ssd_ms": ssd_ms,
        "omissions": float(np.isnan(go).mean()),
    }
    refusal = _refusal(estimates)
    if refusal and checked:
        raise InputError(
            f"{refusal}: no stop-signal reaction time (Verbruggen et al. 2019)", "trials"
        )
    return StopEstimate(**estimates, refusal=refusal)


def of_few(trials: StopTrials) -> list[str]:
    """Return a warning of too few stop trials."""
    stops = int(trials.stop.sum())
    text = f"{stops} stop trials, fewer than {FEWEST_STOPS}: the estimate is unreliable"
    return [text] if stops < FEWEST_STOPS else []


def integrated(trials: StopTrials) -> float:
    """Return the estimate by integration, ms."""
    mean_ms = float(trials.ssd_ms[trials.stop].mean())
    return nth_time(_go_times(trials), trials.p_respond) - mean_ms


def _go_times(trials: StopTrials) -> Array:
    """Return the times of go trials, ms; missed ones count as the slowest."""
    go = trials.rt_ms[~trials.stop]
    return np.where(np.isnan(go), np.nanmax(go), go)


def _refusal(values: dict[str, float]) -> str:
    low, high = P_RANGE
    if not low <= values["p_respond"] <= high:
        outside = f"outside {low} to {high}"
        return (
            f"the probability of responding on stop trials is {values['p_respond']:.2f}, {outside}"
        )
    if values["failed_ms"] > values["go_ms"]:
        slower = f"{values['failed_ms']:.0f} ms against {values['go_ms']:.0f} ms"
        return f"failed stops are slower than go responses, {slower}, so the race model fails"
    return ""


def inhibition_function(trials: StopTrials) -> pd.DataFrame:
    """Return the probability of responding at each stop-signal delay, one row each.

    ``ssrt_ms`` is the quantile of go times at p_respond minus the delay, the same at all delays in
    an independent race.
    """
    go_ms, rows = _go_times(trials), []
    for delay in np.unique(trials.ssd_ms[trials.stop]):
        times = trials.rt_ms[trials.ssd_ms == delay]
        failed = times[~np.isnan(times)]
        p = len(failed) / len(times)
        low, high = map(float, wilson(len(failed), len(times)))
        inside = 0 < p < 1
        ssrt = nth_time(go_ms, p) - delay if inside else np.nan
        mean = failed.mean() if len(failed) else np.nan
        rows.append((delay, len(times), p, low, high, mean, ssrt))
    names = ["ssd_ms", "trials", "p_respond", "low", "high", "failed_ms", "ssrt_ms"]
    return Readable(rows, columns=names)


def ssrt_by_delay(table: pd.DataFrame) -> float:
    """Return the mean ssrt_ms of an ``inhibition_function``, weighted by trials; NaN without any.

    ``estimate_ssrt`` pools all delays, which is biased where they spread as widely as go times.
    """
    used = table[table["p_respond"].between(*P_RANGE)]
    return float(np.average(used["ssrt_ms"], weights=used["trials"])) if len(used) else np.nan


def nth_time(times_ms: Array, p: float) -> float:
    """Return the n-th shortest time, where n is p times the number of times, rounded up."""
    return float(np.quantile(times_ms, p, method="inverted_cdf"))


def reported(trials: StopTrials, task: StopTask) -> tuple[str, pd.DataFrame, dict[str, Any]]:
    """Return the estimates of simulated stop trials: a text, the inhibition function, facts."""
    estimate, table = estimate_ssrt(trials, checked=False), inhibition_function(trials)
    ssrt_ms = ssrt_by_delay(table)
    facts = {**vars(estimate), "ssrt_by_delay_ms": ssrt_ms, "trials": len(trials.rt_ms)}
    if np.isnan(ssrt_ms):
        facts |= {"ssrt_ms": None, "ssrt_mean_ms": None}
    return f"{table.round(3).to_string(index=False)}\n{told(estimate, ssrt_ms, task)}", table, facts


def told(ssrt: StopEstimate, ssrt_ms: float, task: StopTask) -> str:
    """Return estimates of simulated stop trials in sentences; ``ssrt_ms`` is by each delay."""
    failed, missed = ssrt.failed_minus_go_ms, ""
    if ssrt.omissions:
        missed = f", {ssrt.omissions:.1%} of go trials missed"
    times = "no failed stops" if np.isnan(failed) else f"failed stops {failed:+.0f} ms"
    low, high = P_RANGE
    if np.isnan(ssrt_ms):
        estimate = (
            "no stop-signal reaction time: at no delay do "
            f"{low:.0%} to {high:.0%} of the stop trials have a response"
        )
    else:
        estimate = (
            f"stop-signal reaction time {ssrt_ms:.0f} ms by integration at each delay, which is "
            f"the one to report for fixed delays ({ssrt.ssrt_ms:.0f} ms with all delays pooled, "
            f"for staircases); {task.delay_ms:g} ms of it are the given delay to {task.nucleus}; "
            "there are no motor delays"
        )
    refused = f"\nthe consensus guide accepts no estimate: {ssrt.refusal}" if ssrt.refusal else ""
    return (
        f"mean go time {ssrt.go_ms:.0f} ms{missed}, {times}, responses in {ssrt.p_respond:.1%} "
        f"of stop trials\n{estimate}{refused}"
    )


MOST_DELAYS, STEP_MS = 12, 50.0
"""Largest number of delays drawn one by one, and the steps to which more are pooled."""


@styled
def draw(
    trials: StopTrials,
    models: Mapping[str, Sequence[StopTrials]] | None = None,
    heading: str = "",
) -> Figure:
    """Draw the inhibition function and times; models are given by copies with their responses."""
    with quiet(DataWarning):  # few trials are in the title
        ssrt = estimate_ssrt(trials, checked=False)
    go = trials.rt_ms[~trials.stop]
    failed = trials.rt_ms[trials.stop]
    figure, ((left, right),) = panels(1, 2, size=(6.4, 2.8))
    shown = _pooled(trials)
    table = inhibition_function(shown)
    ends = np.abs(table[["low", "high"]].to_numpy() - table[["p_respond"]].to_numpy()).T
    style: Look = {"ms": 4, "color": PALETTE[0], "label": "Stop trials"}
    left.errorbar(table["ssd_ms"], table["p_respond"], ends, fmt="o", capsize=2, **style)
    if models:
        delays, place = np.unique(shown.ssd_ms[trials.stop], return_inverse=True)
        styles = zip(models.items(), PALETTE[2:], ("--", ":", "-.", "-"), strict=False)
        for (name, model), colour, dashes in styles:
            rt_ms = np.array([each.rt_ms[trials.stop] for each in model])
            p = np.bincount(place, (~np.isnan(rt_ms)).mean(axis=0)) / np.bincount(place)
            left.plot(delays, p, color=colour, ls=dashes, label=name)
            _cumulative(right, rt_ms.ravel(), f"Failed stops, {name}", colour, dashes)
    else:
        delays = np.linspace(0, float(np.nanmax(trials.ssd_ms)), 200)
        ssrt_ms = ssrt_by_delay(inhibition_function(trials))
        race = np.searchsorted(np.sort(go), delays + ssrt_ms, side="right") / len(go)  # NaN is last
        left.plot(delays, race, color=GREY, label=f"Race, SSRT {ssrt_ms:.0f} ms")
    left.set(xlabel="Stop-signal delay (ms)", ylabel="Share with a response", ylim=(-0.03, 1.03))
    left.legend(loc="lower left", bbox_to_anchor=(0, 1), ncols=2)
    _cumulative(right, go, "Go trials", PALETTE[0], "-")
    failed = failed if models else failed[~np.isnan(failed)]
    _cumulative(right, failed, "Failed stops", PALETTE[1], "--")
    right.set(xlabel="Response time (ms)", ylabel="Cumulative share", ylim=(-0.03, 1.03))
    right.legend(loc="lower left", bbox_to_anchor=(0, 1), ncols=2)
    stops = int(trials.stop.sum())
    title = f"{len(go)} go trials, {stops} stop trials; bars: 95 % Wilson intervals"
    title += ", delays to the nearest 50 ms" if shown is not trials else ""
    title = f"{heading}: {title}" if heading else title
    refused = f"\nThe consensus guide accepts no SSRT: {ssrt.refusal}" if ssrt.refusal else ""
    figure.suptitle(title + refused, x=0.01, ha="left")
    return figure


def _pooled(trials: StopTrials) -> StopTrials:
    """Return the trials with delays to the nearest step of 50 ms where there are many delays."""
    if len(np.unique(trials.ssd_ms[trials.stop])) <= MOST_DELAYS:
        return trials
    return replace(trials, ssd_ms=np.round(trials.ssd_ms / STEP_MS) * STEP_MS)


def _cumulative(ax: Axes, times_ms: Array, label: str, colour: str, style: str) -> None:
    """Draw the share of trials that responded up to a time; trials without a response are in it."""
    made = np.sort(times_ms[~np.isnan(times_ms)])
    if len(made):
        ax.step(made, np.arange(1, len(made) + 1) / len(times_ms), where="post", color=colour,
                ls=style, label=label)  # fmt: skip
