"""The circuit's predictions for people on and off medication, and the comparison with people.

A prediction is a range. In contrasts that involve patients off medication it spans the levels of
dopamine that are assumed for them; for all others it is a tolerance around the circuit's value, the
largest difference that does not count.
"""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np
import pandas as pd

from bgmodel.experiments.expected import AGREES, DISAGREES
from bgmodel.support.toml_files import read
from circuits.errors import require
from figures.dopamine.simon import QUANTILES, named, of_people, within
from figures.dopamine.simon_model import Simon, simulated

TOLD = Path(__file__).with_name("medication.toml")
"""The predictions, committed before people were analysed."""
OPEN = "not told apart"
KINDS = MAIN, _ = ("pulse", "fading")
"""Courses of the location's input; the second one only in training."""
NORMAL = 1.0
"""Level of dopamine of controls, and of patients on medication."""
OFF = (0.95, 0.9, 0.85)
"""Levels assumed off medication; that of the experiment on stop signals is 0.9."""
CONTROLS, ON_OFF, OFF_CONTROLS, ON_CONTROLS, SESSIONS = CONTRASTS = (
    "controls", "on - off", "off - controls", "on - controls", "session 2 - 1",
)  # fmt: skip
PRINTED = ("congruent_ms", "incongruent_ms", "cost_ms", "congruent_right", "incongruent_right")
"""Measures whose means were known before the predictions, except by session."""
BY_QUANTILE = tuple(f"{begun}q{100 * q:.0f}_ms" for begun in ("", "cost_") for q in QUANTILES)
BY_SPEED = tuple(f"{c}_{e}" for c in ("congruent", "incongruent") for e in ("fast", "slow", "rise"))
TRAINED = (*PRINTED, *BY_QUANTILE, "delta_ms", *BY_SPEED, "missed")
CHOSEN = ("better_near", "better_far", "test_near_s", "test_far_s", "test_slope_s")
BETWEEN = (*PRINTED, "q10_ms", "q50_ms", "q90_ms", "delta_ms", "incongruent_rise", "missed")
MEASURES = {
    CONTROLS: (*TRAINED, *CHOSEN),
    ON_OFF: (*TRAINED, *CHOSEN, "choose_less_avoid"),
    OFF_CONTROLS: (*BETWEEN, *CHOSEN),
    ON_CONTROLS: (*BETWEEN, *CHOSEN),
    SESSIONS: (*BETWEEN, *CHOSEN),
}
"""Measures that are predicted in each contrast."""
TOLERANCE = {"q": 26.0, "cost": 10.0, "delta": 20.0, "missed": 0.02, "test": 0.1}
"""By how the name of a measure begins: 26 ms are two standard errors of the controls' mean time."""
SHARE = 0.02
"""Tolerance of shares of choices."""


@dataclass(frozen=True)
class Prediction:
    """A predicted range of one measure in one contrast.

    Parameters
    ----------
    kind, contrast, measure : str
        Course of the location's input; a name in CONTRASTS; a measure of ``simon.measures``.
    value, low, high : float
        The circuit's value at the middle level of dopamine, and the range.
    printed : bool
        Whether the people's mean was known beforehand.
    """

    kind: str
    contrast: str
    measure: str
    value: float
    low: float
    high: float
    printed: bool

    def __post_init__(self) -> None:
        require(self.contrast in CONTRASTS, "contrast", f"must be of {CONTRASTS}", self.contrast)
        known = MEASURES[self.contrast]
        require(self.measure in known, "measure", f"must be one of {known}", self.measure)
        ordered = self.low <= self.value <= self.high
        require(ordered, "value", "must lie between low and high", self.value)

    @property
    def sign(self) -> str:
        """Whether the range is above 0, below it, or contains it: +, - or 0."""
        return "+" if self.low > 0 else "-" if self.high < 0 else "0"

    def outcome(self, low: float, high: float) -> str:
        """Return whether people agree, from their 95 % interval.

        They disagree if the interval lies outside the range. They agree if it overlaps a range
        without 0 and excludes 0 itself, or lies inside a range that contains 0. Otherwise the
        prediction and its absence are not told apart.
        """
        if not (np.isfinite(low) and np.isfinite(high)):
            return OPEN
        if high < self.low or low > self.high:
            return DISAGREES
        if self.sign == "0":
            return AGREES if self.low <= low and high <= self.high else OPEN
        return AGREES if low > 0 or high < 0 else OPEN


@dataclass(frozen=True)
class Told:
    """The contents of the file of predictions."""

    seed: int
    people: int
    models: list[Simon]
    predictions: list[Prediction]

    def of(self, kind: str) -> Simon:
        """Return the parameters of a kind."""
        return next(each for each in self.models if each.kind == kind)


def told(path: Path = TOLD) -> Told:
    """Return the predictions of a file; ValueError if it is invalid."""
    return read(path, Told)


def written(told: Told) -> str:
    """Return predictions as the text of a file."""
    lines = ["# Written by python -m benchmarks.tuning.simon, before people were analysed.", ""]
    lines += [f"seed = {told.seed}", f"people = {told.people}"]
    for name in ("models", "predictions"):
        rows = [
            {f.name: getattr(each, f.name) for f in fields(each)} for each in getattr(told, name)
        ]
        inside = [
            ", ".join(f"{key} = {_text(value)}" for key, value in row.items()) for row in rows
        ]
        lines += ["", f"{name} = [", *(f"  {{ {each} }}," for each in inside), "]"]
    text = "\n".join(lines) + "\n"
    tomllib.loads(text)
    return text


def _text(value: object) -> str:
    return (
        {True: "true", False: "false"}[value]
        if isinstance(value, bool)
        else (f'"{value}"' if isinstance(value, str) else f"{value:.4g}")
    )


def models(simon: Simon, people: int, seed: int, *, tested: bool) -> dict[float, pd.DataFrame]:
    """Return the measures of simulated people at each level of dopamine, a row per person."""
    by_level = {}
    for level in (NORMAL, *OFF):
        trials = simulated(simon, level, people, seed, tested=tested)
        by_level[level] = of_people(trials.assign(session=1, medication=f"{level:g}"))
    return by_level


def contrasts(by_level: Mapping[float, pd.DataFrame]) -> pd.DataFrame:
    """Return the circuit's value of each contrast by level, with its error over simulated people.

    Columns contrast, dopamine (off medication), measure, value, error.
    """
    names = named(by_level[NORMAL])
    rows = [_row(CONTROLS, NORMAL, by_level[NORMAL][names])]
    for level in OFF:
        both = pd.concat([by_level[NORMAL], by_level[level]])
        change = within(both, "medication", f"{NORMAL:g}", f"{level:g}")
        rows += [_row(ON_OFF, level, change), _row(OFF_CONTROLS, level, -change)]
    table = pd.concat(rows, ignore_index=True)
    pairs = zip(table["contrast"], table["measure"], strict=True)
    kept = [measure in MEASURES[contrast] for contrast, measure in pairs]
    return table[kept].reset_index(drop=True)


def _row(contrast: str, level: float, each: pd.DataFrame) -> pd.DataFrame:
    about = {"contrast": contrast, "dopamine": level, "measure": list(each)}
    return pd.DataFrame(about | {"value": each.mean().to_numpy(), "error": each.sem().to_numpy()})


def predictions(kind: str, table: pd.DataFrame) -> list[Prediction]:
    """Return the predictions that follow from the contrasts of a kind.

    The circuit has no practice, and patients on medication are controls in it: there the
    prediction is 0.
    """
    predicted = []
    for contrast, name in lines(kind):
        rows = table[(table["contrast"] == contrast) & (table["measure"] == name)]
        if contrast in (ON_CONTROLS, SESSIONS):
            value, low, high = 0.0, -tolerance(name), tolerance(name)
        elif contrast == CONTROLS:
            value = float(rows["value"].iloc[0])
            low, high = value - tolerance(name), value + tolerance(name)
        else:
            value = float(rows["value"].iloc[1])
            low = float((rows["value"] - 2 * rows["error"]).min())
            high = float((rows["value"] + 2 * rows["error"]).max())
        known = contrast != SESSIONS and name in PRINTED
        known |= contrast == CONTROLS and name == "missed"
        predicted.append(Prediction(kind, contrast, name, value, low, high, known))
    return predicted


def lines(kind: str) -> list[tuple[str, str]]:
    """Return the contrasts and measures predicted with a course of the location's input."""
    if kind != MAIN:
        return [(contrast, name) for contrast in (CONTROLS, ON_OFF) for name in TRAINED]
    return [(contrast, name) for contrast, names in MEASURES.items() for name in names]


def tolerance(name: str) -> float:
    """Return the largest difference of a measure that does not count."""
    known = [size for begun, size in TOLERANCE.items() if name.startswith(begun)]
    return known[0] if known else TOLERANCE["q"] if name.endswith("_ms") else SHARE
