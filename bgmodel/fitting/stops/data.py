"""Stop-signal trials of several participants, laid out for fits, and their go processes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import pandas as pd

from bgmodel.fitting.exact.algorithms import GapModel
from bgmodel.fitting.likelihood import likelihood_of
from bgmodel.fitting.optimum import optimum
from bgmodel.fitting.trials.design import design_of
from bgmodel.stopping.trials import StopTrials
from bgmodel.stopping.violations import AFTER, slowing_of
from bgmodel.support.arrays import Array, Integers, Truths
from bgmodel.trials.record import Trials
from circuits.errors import DataWarning, InputError, require

STEP_MS, EARLIEST_MS = 5.0, -300.0
"""Resolution and beginning of the times at which distributions of go times are tabulated."""
BEYOND_MS = 600.0
"""How far they extend beyond the longest time."""
FEWEST_GO = 10
"""Fewest go responses of a participant in a fit."""
LAPSE = 0.02
"""Proportion of lapses in fits of the go process, which is not fitted."""
GO = ("sensitivity", "bound", "t0_s", "t0_sd_s")
"""Parameters of the go process: a diffusion between constant bounds (``GapModel``)."""


@dataclass(frozen=True)
class StopData:
    """Stop trials of several participants, one after the other, and their go times.

    Parameters
    ----------
    names : tuple of str
        Participants.
    go_ms : tuple of array, ms
        Go times of each participant, without the slowing after stop trials.
    responded : array (people,)
        Proportion of go trials with a response.
    deadline_ms : float
        The longest time of a response, of all participants.
    person, number : int array (trials,)
        Participant of each stop trial, and its number among the participant's stop trials, from 0.
    ssd_ms, rt_ms : array (trials,), ms
        Its delay; its response time, NaN without a response.
    slower_ms : array (trials,), ms
        How much slower go responses are after the kind of trial that came before it.
    """

    names: tuple[str, ...]
    go_ms: tuple[Array, ...]
    responded: Array
    deadline_ms: float
    person: Integers
    number: Integers
    ssd_ms: Array
    rt_ms: Array
    slower_ms: Array

    @property
    def failed(self) -> Truths:
        """Which stop trials have a response, (trials,)."""
        return ~np.isnan(self.rt_ms)

    @property
    def grid_ms(self) -> Array:
        """Times at which distributions are tabulated, (times,), ms."""
        return np.asarray(np.arange(EARLIEST_MS, self.deadline_ms + BEYOND_MS, STEP_MS), float)

    @cached_property
    def go_below(self) -> Array:
        """Proportion of go trials with a response up to each time of the grid, (people, times)."""
        counted = [
            np.searchsorted(np.sort(go), self.grid_ms, side="right") / len(go) * share
            for go, share in zip(self.go_ms, self.responded, strict=True)
        ]
        return np.array(counted)

    def where(self, mask: Truths) -> StopData:
        """Return a subset of the stop trials, with all go times."""
        names = ("person", "number", "ssd_ms", "rt_ms", "slower_ms")
        return replace(self, **{name: getattr(self, name)[mask] for name in names})


def stop_data(people: Mapping[str, StopTrials], *, slowed: bool = True) -> StopData:
    """Lay out the stop trials of participants for a fit.

    Parameters
    ----------
    people : mapping from names to StopTrials
        Trials of each participant, in the order in which they were run.
    slowed : bool
        Whether go processes are slower after stop trials: by the means over participants, for
        failed and for successful stops. Otherwise all trials have the same distribution.

    Raises
    ------
    ValueError
        If no participant has stop trials and at least 10 go responses.

    Warns
    -----
    UserWarning
        If some have not; they are left out.
    """
    kept = {
        who: each for who, each in people.items()
        if each.stop.any() and (each.responded & ~each.stop).sum() >= FEWEST_GO
    }  # fmt: skip
    must = f"must have a participant with stop trials and {FEWEST_GO} go responses"
    require(kept, "people", must, len(people))
    if len(kept) < len(people):
        said = f"without stop trials or with fewer than {FEWEST_GO} go responses"
        DataWarning.warn(f"{len(people) - len(kept)} participants {said} are left out")
    effects = _slowing(kept) if slowed else dict.fromkeys(AFTER, 0.0)
    go, responded, parts = [], [], []
    for number, each in enumerate(kept.values()):
        before = np.append("", each.outcome[:-1])
        slower = np.select([before == name for name in AFTER], [effects[name] for name in AFTER])
        of_go = ~each.stop & each.responded
        go.append(each.rt_ms[of_go] - slower[of_go])
        responded.append(of_go.sum() / (~each.stop).sum())
        stops = np.flatnonzero(each.stop)
        count = np.arange(len(stops))
        parts.append((np.full(len(stops), number), count, each.ssd_ms[stops], each.rt_ms[stops],
                      slower[stops]))  # fmt: skip
    longest = max(float(np.nanmax(each.rt_ms)) for each in kept.values())
    columns = [np.concatenate(column) for column in zip(*parts, strict=True)]
    return StopData(tuple(kept), tuple(go), np.array(responded), longest, *columns)


def _slowing(people: Mapping[str, StopTrials]) -> dict[str, float]:
    """Return the slowing after failed and successful stops, mean over participants, ms."""
    table = slowing_of(people).set_index("measure")["value"]
    found = {name: float(table[f"after_{name.replace(' ', '_')}_ms"]) for name in AFTER}
    return {name: value if np.isfinite(value) else 0.0 for name, value in found.items()}


def go_processes(people: Mapping[str, StopTrials]) -> pd.DataFrame:
    """Fit a diffusion between constant bounds to the go trials of each participant.

    Returns
    -------
    DataFrame
        One row per participant: participant_id and ``GO``. They are NaN where it is unknown which
        responses are correct, where fewer are correct than by chance, and for participants with
        fewer than 10 go responses.
    """
    rows = [{"participant_id": who, **_go_process(each, who)} for who, each in people.items()]
    return pd.DataFrame(rows)


def aligned(
    data: StopData, people: Mapping[str, StopTrials], go: pd.DataFrame | None
) -> pd.DataFrame:
    """Return the go processes of the participants of data, in their order; fitted unless given."""
    if go is None:
        go = go_processes({name: people[name] for name in data.names})
    return go.set_index("participant_id").loc[list(data.names)].reset_index()


def _go_process(trials: StopTrials, who: str) -> dict[str, float]:
    """Return the parameters of a participant's go process, by maximum likelihood."""
    unknown = dict.fromkeys(GO, np.nan)
    go = ~trials.stop & trials.responded
    if trials.correct is None or go.sum() < FEWEST_GO:
        return unknown
    right = trials.correct[go].astype(np.int8)
    choices = Trials(
        np.full(len(right), who), trials.rt_ms[go] / 1000, right, None,
        pd.DataFrame(index=range(len(right))),
    )  # fmt: skip
    try:
        design = design_of(choices)
    except InputError:
        return unknown
    return optimum(likelihood_of(GapModel(), design, fixed={"lapse": LAPSE})).values
