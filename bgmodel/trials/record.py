"""One row per trial: choices and their times, stop signals, rewards, spikes."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import numpy.typing as npt
import pandas as pd

from bgmodel.support.saved import Facts, span
from bgmodel.trials import alternatives as several
from bgmodel.trials.columns import MISSING_RT, NO_RESPONSE
from bgmodel.trials.spikes import RecordedSpikes, joined_spikes
from bgmodel.trials.timed_readings import Readings
from circuits.arrays import Array, Truths
from circuits.errors import InputError, require

KINDS = (
    "choices",
    "spikes and choices",
    "known evidence",
    "stop-signal trials",
    "rewarded choices",
)
"""Kinds of trials: by the columns that they have in addition to choices and times."""
MOST_LEVELS = 30
"""A condition with more values than this, all of them numbers, is a covariate."""


def is_covariate(column: pd.Series) -> bool:
    """Whether a condition is a covariate, such as a physiological signal, and has no levels."""
    many = column.nunique() > MOST_LEVELS
    return bool(many and pd.to_numeric(column, errors="coerce").notna().all())


@dataclass(frozen=True, eq=False, repr=False)
class Trials(Facts):
    """Trials of one person or more, in the order in which they were run.

    Arrays have one value per trial. ValueError if they differ in length, a response has another
    value, or times are given where there are no responses or the reverse.
    """

    participant: npt.NDArray[np.str_]
    # Time from onset to response, s; NaN without a response, for one that is withheld, and in all
    # trials if only choices were recorded.
    rt_s: Array
    # 1 or 0; -1 without a response. With more than two alternatives 1 is the correct one.
    response: npt.NDArray[np.int8]
    # Signed: positive favours response 1, with more than two alternatives the correct one.
    strength: Array | None
    conditions: pd.DataFrame  # columns of text; ``is_covariate`` tells which are numbers
    deadline_s: float | None = None  # time at which a trial without a response ended
    source: str = "a table"  # a file, a shipped set, or "a table"
    alternatives: int = 2  # from 2 to 12
    ssd_s: Array | None = None  # stop-signal delays; NaN in go trials
    reward: Array | None = None
    # If the evidence is known: response 1 is then the second alternative; of more than two, the
    # one that the readings before the response favour.
    readings: Readings | None = None
    withheld: int | None = None  # the response that is given by waiting until the deadline
    spikes: RecordedSpikes | None = None
    checksum: str = field(init=False)  # SHA-256 of all fields above except the source

    def __post_init__(self) -> None:
        lengths = [len(self.participant), self.trials, len(self.response), len(self.conditions)]
        lengths += [len(each) for each in self._more.values() if each is not None]
        lengths += [len(self.readings.ids)] if self.readings is not None else []
        lengths += [len(self.spikes.recorded)] if self.spikes is not None else []
        if len(set(lengths)) > 1:
            raise InputError(f"choices need one value per trial, got {lengths}", "response")
        coded = np.isin(self.response, (0, 1, NO_RESPONSE)).all()
        require(coded, "response", "must hold 1, 0 or -1", np.unique(self.response))
        if self.withheld is not None:
            require(self.withheld in (0, 1), "withheld", "must be 1 or 0", self.withheld)
            must = "must be given, s, if a response is given by waiting until then"
            require(self.deadline_s is not None, "deadline_s", must, None)
        silent = (self.response == NO_RESPONSE) | (self.response == self.withheld)
        if self.timed and not np.array_equal(np.isnan(self.rt_s), silent):
            must = "must be NaN where response is -1 or withheld, and nowhere else, or everywhere"
            raise InputError(f"rt_s {must}", "rt_s")
        several.check_number(self.alternatives)
        if self.alternatives > 2 and self.strength is not None and (self.strength < 0).any():
            must = "must be 0 or more with more than two alternatives: it favours the correct one"
            raise InputError.of("strength", must, float(self.strength.min()))
        object.__setattr__(self, "checksum", self._digest())

    @property
    def _more(self) -> dict[str, Array | None]:
        return {"strength": self.strength, "ssd_s": self.ssd_s, "reward": self.reward}

    @property
    def kind(self) -> str:
        """What was done in these trials; a name in ``KINDS``."""
        parts = (self.spikes, self.readings, self.ssd_s, self.reward)
        return next((k for k, x in zip(KINDS[1:], parts, strict=True) if x is not None), KINDS[0])

    @property
    def timed(self) -> bool:
        """Whether responses have times; otherwise only choices were recorded."""
        answered = (self.response != NO_RESPONSE) & (self.response != self.withheld)
        return bool(np.isfinite(self.rt_s).any() or not answered.any())

    @property
    def trials(self) -> int:
        """Number of trials."""
        return len(self.rt_s)

    @property
    def correct(self) -> Array:
        """1 or 0 for the side of the strength (response 1 without); NaN if unknown, (trials,)."""
        side = np.ones(self.trials)
        if self.strength is not None and self.alternatives == 2:
            side = np.sign(self.strength)
        right = (self.response == 1) == (side > 0)
        return np.where((self.response == NO_RESPONSE) | (side == 0), np.nan, right)

    def where(self, mask: Truths) -> Trials:
        """Return a subset of the trials; ``mask`` is (trials,) bool."""
        per_trial = ("participant", "rt_s", "response", *self._more)
        columns = {name: getattr(self, name) for name in per_trial}
        parts: dict[str, Any] = {n: None if x is None else x[mask] for n, x in columns.items()}
        for name, each in (("readings", self.readings), ("spikes", self.spikes)):
            parts[name] = None if each is None else each.where(mask)
        return replace(self, conditions=self.conditions.loc[mask].reset_index(drop=True), **parts)

    def people(self) -> list[str]:
        """Return the participants, sorted."""
        return sorted({str(name) for name in self.participant})

    def by_participant(self) -> dict[str, Trials]:
        """Return the trials of each participant."""
        return {who: self.where(self.participant == who) for who in self.people()}

    def facts(self) -> dict[str, str]:
        """Return the numbers of trials, participants and responses, and the range of times."""
        known = {"source": self.source, "trials": f"{self.trials}"}
        known["participants"] = f"{len(self.people())}"
        for code in (1, 0, NO_RESPONSE):
            count = np.sum(self.response == code)
            known["no response" if code == NO_RESPONSE else f"responses {code}"] = f"{count}"
        return {**known, "rt_s": span(self.rt_s)}

    def summary(self) -> str:
        """Return one sentence: trials, participants, responses and times."""
        known, who = self.facts(), len(self.people())
        end = "" if self.deadline_s is None else f" by {self.deadline_s:g} s"
        return (
            f"{self.source}: {self.trials} trials of {who} participant{'s' * (who != 1)}, response "
            f"1 in {known['responses 1']}, 0 in {known['responses 0']}, none{end} in "
            f"{known['no response']}, "
            + (f"times {known['rt_s']} s" if self.timed else "without times")
        )

    def to_pyddm(self) -> pd.DataFrame:
        """Return them for ``pyddm.Sample.from_pandas_dataframe(table, "rt", "choice")``."""
        coded = np.where(self.response == NO_RESPONSE, np.nan, self.response)
        who = {"participant_id": self.participant} if len(self.people()) > 1 else {}
        return pd.DataFrame({"rt": self.rt_s, "choice": coded, **who, **self._given("choice")})

    def to_hssm(self) -> pd.DataFrame:
        """Return them for ``hssm.HSSM(data=table)``; rt is -999 without a response."""
        who = pd.Series(self.participant)
        return pd.DataFrame(
            {
                "participant_id": who,
                "trial": who.groupby(who).cumcount(),
                "rt": np.where(np.isnan(self.rt_s), MISSING_RT, self.rt_s),
                "response": np.where(self.response == 1, 1, -1),
                **self._given("participant_id", "trial", "response"),
            }
        )

    def _given(self, *taken: str) -> dict[str, Any]:
        columns: dict[str, Any] = {} if self.strength is None else {"strength": self.strength}
        both = sorted({*taken, "rt", "participant_id", *columns} & {*self.conditions})
        if both:
            message = f"conditions must be other columns than {', '.join(both)}"
            raise InputError(message, "conditions")
        return columns | {str(name): self.conditions[name].to_numpy() for name in self.conditions}

    def _digest(self) -> str:
        texts = {name: self.conditions[name].tolist() for name in self.conditions}
        digest = hashlib.sha256()
        plain = [self.participant.tolist(), texts, self.deadline_s, self.strength is None]
        plain += [self.alternatives] if self.alternatives > 2 else []
        plain += [] if self.withheld is None else ["withheld", self.withheld]
        digest.update(json.dumps(plain).encode())
        columns: list[Any] = [self.rt_s, self.response, *self._more.values()]
        if self.readings is not None:
            read = self.readings
            columns += [read.log_likelihood, read.time_s, read.choice, np.array([read.forced])]
            digest.update(json.dumps([read.names, read.ids]).encode())
        if self.spikes is not None:
            columns += [self.spikes.time_s, self.spikes.trial, self.spikes.cell]
            digest.update(json.dumps(self.spikes.names).encode())
        for values in columns:
            if values is not None:
                # One NaN and one zero.
                same = np.where(np.isnan(values), np.nan, values + 0.0)
                digest.update(same.astype("<f8").tobytes())
        return digest.hexdigest()


def joined(parts: Sequence[Trials]) -> Trials:
    """Return trials of several people, one after the other, that have the same columns."""
    first = parts[0]
    columns = ("participant", "rt_s", "response", *first._more)
    every = {name: [getattr(part, name) for part in parts] for name in columns}
    made: dict[str, Any] = {
        n: None if x[0] is None else np.concatenate(x) for n, x in every.items()
    }
    if first.readings is not None:
        read = [part.readings for part in parts if part.readings is not None]
        of = {name: np.concatenate([getattr(each, name) for each in read])
              for name in ("log_likelihood", "time_s", "lengths", "choice")}  # fmt: skip
        made["readings"] = replace(
            first.readings, ids=[one for each in read for one in each.ids], **of
        )
    if first.spikes is not None:
        made["spikes"] = joined_spikes([part.spikes for part in parts if part.spikes is not None])
    conditions = pd.concat([part.conditions for part in parts], ignore_index=True)
    return replace(first, conditions=conditions, **made)


QUANTILES = (0.1, 0.5, 0.9)


def statistics(choices: Trials) -> pd.DataFrame:
    """Return accuracy and times (s) of each participant, condition and size of the strength.

    ``missing`` counts trials without a response; ``accuracy`` is NaN if unknown.
    """
    table = pd.DataFrame({"participant_id": choices.participant}).join(choices.conditions)
    if choices.strength is not None:
        table["strength"] = np.abs(choices.strength)
    keys = list(table.columns)
    table = table.assign(_time=choices.rt_s, _right=choices.correct, _none=choices.response < 0)
    cells = table.groupby(keys, sort=True)
    every = {
        "trials": ("_none", "size"), "missing": ("_none", "sum"), "accuracy": ("_right", "mean"),
        "mean_s": ("_time", "mean"), "sd_s": ("_time", "std"),
    }  # fmt: skip
    quantiles = cells["_time"].quantile(np.array(QUANTILES)).unstack()
    quantiles.columns = [f"q{100 * q:.0f}_s" for q in QUANTILES]
    return cells.agg(**every).join(quantiles).reset_index()
