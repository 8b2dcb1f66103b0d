"""Checks of the types of user input: numbers, whole numbers, arrays of numbers; several at once."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import fields
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from circuits.arrays import Integers, Reals
from circuits.checks import check_finite as check_finite
from circuits.checks import check_positive as check_positive
from circuits.checks import check_range as check_range
from circuits.checks import is_number as is_number
from circuits.checks import is_whole as is_whole
from circuits.errors import InputError, require

MOST_SAID = 390
"""Longest message of several problems; the rest are counted."""


def whole(name: str, value: Any, least: int) -> int:
    """Return a whole number; ValueError unless it is one and at least ``least``."""
    require(is_whole(value) and value >= least, name, f"must be a whole number >= {least}", value)
    return int(value)


def check_inside(name: str, values: Integers, low: int, high: int) -> None:
    """Raise ValueError unless all numbers of an array are within a range, its ends included."""
    if values.min() < low or values.max() > high:
        raise InputError(
            f"{name} must be within {low}..{high}, got {values.min()}..{values.max()}", name
        )


def reals(name: str, values: npt.ArrayLike) -> Reals:
    """Return a float array, as compiled loops require; masked and non-real values are refused."""
    if np.ma.is_masked(values):
        raise InputError(
            f"{name} must hold every value, got a masked array: numpy would read what is masked",
            name,
        )
    try:
        array = np.asarray(values)
        if array.dtype in (np.float32, np.float64):
            return array
        if array.dtype.kind in "fiubO":
            return array.astype(np.float64)
    except (ValueError, TypeError):
        raise InputError.of(name, "must be an array of real numbers", values) from None
    raise InputError.of(name, "must be an array of real numbers", values)


def one_per_trial(name: str, values: npt.ArrayLike, trials: int) -> Integers:
    """Return whole numbers (trials,); ValueError for another shape or another type."""
    array = np.asarray(values)
    if array.shape != (trials,) or array.dtype.kind not in "iu":
        raise InputError(
            f"{name} must hold one whole number per trial, shape ({trials},), got shape "
            f"{array.shape} of {array.dtype}",
            name,
        )
    return array if array.dtype.isnative else array.astype(array.dtype.newbyteorder("="))


def known_truth(truth: Integers | None) -> Integers:
    """Return the truth of each trial (trials,); ValueError where it is not known."""
    if truth is None:
        raise InputError("errors are counted: the evidence needs the truth of each trial", "truth")
    return truth


def check_flag(name: str, value: object) -> None:
    """Raise ValueError unless a value is True or False."""
    require(isinstance(value, (bool, np.bool_)), name, "must be True or False", value)


def check_unused(settings: Any, names: Iterable[str], reason: str) -> None:
    """Raise ValueError for one of some fields of a record that was given without effect."""
    for each in fields(settings):
        value, usual = getattr(settings, each.name), each.default
        same = value is usual or (isinstance(value, type(usual)) and value == usual)
        if each.name in names and not same:
            raise InputError(f"{each.name} has no effect {reason}: leave it out", each.name)


def path_of(path: str | Path, field: str = "path") -> Path:
    """Return the path of a file; ValueError for anything else."""
    if not isinstance(path, (str, PathLike)):
        raise InputError.of(field, "must be the path of a file", path)
    return Path(path)


class Problems:
    """All problems of a table in one error: ``with problems.caught():`` per independent check."""

    def __init__(self) -> None:
        self.found: list[ValueError] = []

    @contextmanager
    def caught(self) -> Iterator[None]:
        """Keep a ValueError for later."""
        try:
            yield
        except ValueError as error:
            self.found.append(error)

    def refuse(self) -> None:
        """Raise the error that was kept, or one that lists several, with the field of the first."""
        if len(self.found) == 1:
            raise self.found[0]
        if self.found:
            texts = [str(error) for error in self.found]
            message = f"{len(texts)} problems: {texts[0]}"
            for number, text in enumerate(texts[1:], 1):
                if len(message) + len(text) > MOST_SAID:
                    message += f"; and {len(texts) - number} more"
                    break
                message += f"; {text}"
            raise InputError(message, getattr(self.found[0], "field", "table"))
