"""Errors for invalid input, which name the argument, and categories of warnings.

`bgmodel.InputError` is a ``ValueError``, so that ``except ValueError`` catches it. A category of
warnings can be silenced or turned into errors as usual:
``warnings.simplefilter("error", circuits.errors.DeadlineWarning)``.

Code of this package silences or collects its own warnings by `quiet` and `collected`. The filters
of ``warnings`` belong to the whole process: two threads that leave ``warnings.catch_warnings`` in
the order in which they entered it restore the filters of one another, for good.
"""

from __future__ import annotations

import sys
import warnings
from collections.abc import Hashable, Iterable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from typing import Any, Self

import numpy as np

LONGEST = 80
"""Most characters of a value shown in a message."""
INSIDE = ("bgmodel", "circuits", "contextlib", "dataclasses", "functools")
"""Modules that a warning's location must not point at."""


class InputError(ValueError):
    """An invalid argument, field or key.

    Parameters
    ----------
    sentence : str
        The message: the argument, what is allowed, what was given, and the next step.
    field : str
        Name of the argument, the field of a row, the key or the column of a file.
    given : object
        The value that was given.

    Attributes
    ----------
    field : str
    given : object
        The value; its text if the error comes from another process and it is not a number or str.
    """

    def __init__(self, sentence: str, field: Hashable, given: object = None) -> None:
        super().__init__(sentence)
        self.field = str(field)
        self.given = given

    @classmethod
    def of(cls, field: Hashable, must: str, given: object, *, owner: str = "") -> Self:
        """Return an error such as "STN: tau_ms must be >= 0, got -1", of the owner STN."""
        prefix = f"{owner}: " if owner else ""
        return cls(f"{prefix}{field} {must}, got {shown(given)}", field, given)

    def __reduce__(self) -> tuple[Any, ...]:
        plain = self.given is None or isinstance(self.given, (bool, int, float, str))
        return type(self), (str(self), self.field, self.given if plain else shown(self.given))


def require(allowed: object, field: Hashable, must: str, given: object, *, owner: str = "") -> None:
    """Raise ``InputError.of(field, must, given, owner=owner)`` unless ``allowed`` is true."""
    if not allowed:
        raise InputError.of(field, must, given, owner=owner)


def nearest(name: object, known: Iterable[str]) -> str:
    """Return a question for a name that is nearly one of those that are known, or ""."""
    from difflib import get_close_matches

    close = get_close_matches(str(name), list(known), 1)
    return f" (did you mean {close[0]!r}?)" if close else ""


def within(owner: str, error: Exception, field: str) -> InputError:
    """Return an error with its owner, such as a file or a row, named first."""
    message = f"{owner}: {error}" if owner else str(error)
    return InputError(message, getattr(error, "field", field), getattr(error, "given", None))


@contextmanager
def owned(owner: str, field: str, *kinds: type[Exception]) -> Iterator[None]:
    """Name the owner of errors of some kinds first, as ``within``."""
    try:
        yield
    except kinds as error:
        raise within(owner, error, field) from None


def shown(argument: object) -> str:
    """Return a value as shown in messages: on one line, numbers short, text in quotes."""
    value = argument.item() if isinstance(argument, np.generic) else argument
    if isinstance(value, float):
        return f"{value:g}"
    if isinstance(value, (np.dtype, type)):
        return getattr(value, "__name__", str(value))
    if isinstance(value, np.ndarray):
        if value.size > 20:
            return f"an array of {value.dtype}, shape {value.shape}"
        value = value.tolist()
    text = " ".join(repr(value).split())
    return text if len(text) <= LONGEST else f"{text[: LONGEST - 3]}..."


def user_level() -> int:
    """Return the ``stacklevel`` at which a warning points to the line that called the package."""
    level, frame = 1, sys._getframe(1)
    while frame.f_back and frame.f_globals.get("__name__", "").partition(".")[0] in INSIDE:
        level, frame = level + 1, frame.f_back
    return level


class BgmodelWarning(UserWarning):
    """Base class of this package's warnings: there is a result, but it is doubtful."""

    @classmethod
    def warn(cls, sentence: str, **fields: object) -> None:
        """Issue a warning with these attributes that points to the line that called the package.

        Within `collected` or `quiet` its sentence is added to their list instead.
        """
        for kinds, kept in reversed(_COLLECTING.get()):
            if issubclass(cls, kinds):
                kept.append(sentence)
                return
        warning = cls(sentence)
        vars(warning).update(fields)
        warnings.warn(warning, stacklevel=user_level())


_COLLECTING: ContextVar[tuple[tuple[tuple[type[BgmodelWarning], ...], list[str]], ...]]
_COLLECTING = ContextVar("collecting", default=())


@contextmanager
def collected(*kinds: type[BgmodelWarning]) -> Iterator[list[str]]:
    """Yield a list to which this package's warnings within the block are added, not issued.

    Other threads are not affected, also those that start within the block: each thread has its own
    context. The block of a generator must not contain a ``yield``. All kinds by default.
    """
    kept: list[str] = []
    token = _COLLECTING.set((*_COLLECTING.get(), (kinds or (BgmodelWarning,), kept)))
    try:
        yield kept
    finally:
        _COLLECTING.reset(token)


@contextmanager
def quiet(*kinds: type[BgmodelWarning]) -> Iterator[None]:
    """Silence this package's warnings of some categories within a block, all by default."""
    with collected(*kinds):
        yield


class RangeWarning(BgmodelWarning):
    """Evidence or a threshold is outside the range that a circuit can follow."""


class DeadlineWarning(BgmodelWarning):
    """Trials are ended by the deadline rather than by the evidence."""


class NoiseWarning(BgmodelWarning):
    """Decisions follow noise or the prior, or there are too few draws to detect a difference."""


class CalibrationWarning(BgmodelWarning):
    """Posteriors do not match accuracies: check the units and independence of the evidence."""


class DataWarning(BgmodelWarning):
    """A table or an array looks wrong: units, duplicates, rounding, or swapped axes."""


class ConfoundWarning(DataWarning):
    """An ``input`` (its column) comes in all or in none of the trials with some ``truths``."""


class FitWarning(BgmodelWarning):
    """A fit is not identified, misses the data, or rests on too little simulation."""


class LearningWarning(BgmodelWarning):
    """Learning ended worse than it began, at an end of its range, or on too few trials."""


class EditWarning(BgmodelWarning):
    """An edit of a circuit has no effect, or a value of a row is implausible."""
