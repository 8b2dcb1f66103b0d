"""Types of what a user gives to the core: a number, a whole number, an array of numbers."""

from __future__ import annotations

from numbers import Integral, Real
from os import PathLike
from pathlib import Path

import numpy as np
import numpy.typing as npt

from bgmodel.support.arrays import Integers, Reals
from circuits.errors import InputError


def is_number(value: object) -> bool:
    """Whether a value is one real number; text, None, True and False are not."""
    return isinstance(value, Real) and not isinstance(value, bool)


def is_whole(value: object) -> bool:
    """Whether a value is a whole number of whatever type, as 2 or 2.0."""
    return is_number(value) and (isinstance(value, Integral) or float(value).is_integer())  # type: ignore[arg-type]


def whole(name: str, value: object, least: int) -> int:
    """Return a whole number; ValueError unless it is one, and at least ``least``."""
    if not is_whole(value) or value < least:  # type: ignore[operator]
        raise InputError.of(name, f"must be a whole number >= {least}", value)
    return int(value)  # type: ignore[call-overload,no-any-return]


def reals(name: str, values: npt.ArrayLike) -> Reals:
    """Return an array in single or double precision, as compiled loops take it.

    Raises
    ------
    ValueError
        If the values are not real numbers, some of them are masked, or rows differ in length.
    """
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


def checked_truth(truth: npt.ArrayLike, trials: int, hypotheses: int) -> Integers:
    """Return the truth (trials,); ValueError unless each is the number of a hypothesis."""
    values = one_per_trial("truth", truth, trials)
    if values.min() < 0 or values.max() >= hypotheses:
        raise InputError(
            f"truth must lie in 0..{hypotheses - 1}, got {values.min()}..{values.max()}", "truth"
        )
    return values


def check_flag(name: str, value: object) -> None:
    """Raise ValueError unless a value is True or False."""
    if not isinstance(value, (bool, np.bool_)):
        raise InputError.of(name, "must be True or False", value)


def path_of(given: str | Path, field: str = "path") -> Path:
    """Return the path of a file; ValueError for what is none."""
    if not isinstance(given, (str, PathLike)):
        raise InputError.of(field, "must be the path of a file", given)
    return Path(given)
