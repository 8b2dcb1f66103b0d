"""Errors about what was given, which name the argument, and families of warnings.

`bgmodel.InputError` is a ``ValueError``, so that ``except ValueError`` catches it.  A family of
warnings is silenced or made an error as any other:
``warnings.simplefilter("error", bgmodel.DeadlineWarning)``.
"""

from __future__ import annotations

import sys
import warnings
from collections.abc import Hashable
from typing import Any, Self

import numpy as np

LONGEST = 80
"""Characters of a value that a message shows."""
INSIDE = ("bgmodel", "circuits", "contextlib", "functools")
"""Modules whose lines a warning does not point at."""


class InputError(ValueError):
    """An argument, a field or a key that is not allowed.

    Parameters
    ----------
    sentence : str
        One sentence: the argument, what is allowed, what was given, and the next step.
    field : str
        Name of the argument, the field of a row, the key or the column of a file.
    given : object
        The value that was given.

    Attributes
    ----------
    field : str
    given : object
        Its text, where the error comes from another process and the value is no number or text.
    """

    def __init__(self, sentence: str, field: Hashable, given: object = None) -> None:
        super().__init__(sentence)
        self.field = str(field)
        self.given = given

    @classmethod
    def of(cls, field: Hashable, must: str, given: object, *, owner: str = "") -> Self:
        """Return the error "channels must be at least 2, got 1".

        Parameters
        ----------
        field : str
            Name of the argument.
        must : str
            What is allowed, and the verb: "must be at least 2".
        given : object
        owner : str
            What the field belongs to, named first: "STN: tau_ms must be >= 0, got -1".
        """
        said = f"{owner}: " if owner else ""
        return cls(f"{said}{field} {must}, got {shown(given)}", field, given)

    def __reduce__(self) -> tuple[Any, ...]:
        plain = self.given is None or isinstance(self.given, (bool, int, float, str))
        return type(self), (str(self), self.field, self.given if plain else shown(self.given))


def require(allowed: object, field: Hashable, must: str, given: object, *, owner: str = "") -> None:
    """Raise ``InputError.of(field, must, given, owner=owner)`` unless it is allowed."""
    if not allowed:
        raise InputError.of(field, must, given, owner=owner)


def within(owner: str, error: Exception, field: str) -> InputError:
    """Return an error with what it is about, as a file or a row, named first where there is one.

    The field is that of the error, or else the one given.
    """
    said = f"{owner}: {error}" if owner else str(error)
    return InputError(said, getattr(error, "field", field), getattr(error, "given", None))


def shown(given: object) -> str:
    """Return a value as messages show it: one line, numbers short, text in quotes."""
    given = given.item() if isinstance(given, np.generic) else given
    if isinstance(given, float):
        return f"{given:g}"
    if isinstance(given, (np.dtype, type)):
        return getattr(given, "__name__", str(given))
    if isinstance(given, np.ndarray):
        if given.size > 20:
            return f"an array of {given.dtype}, shape {given.shape}"
        given = given.tolist()
    said = " ".join(repr(given).split())
    return said if len(said) <= LONGEST else f"{said[: LONGEST - 3]}..."


def user_level() -> int:
    """Return the ``stacklevel`` with which a warning points at the line that called the package.

    Frames of this package are skipped, and those of the standard library between them.
    """
    level, frame = 1, sys._getframe(1)
    while frame.f_back and frame.f_globals.get("__name__", "").partition(".")[0] in INSIDE:
        level, frame = level + 1, frame.f_back
    return level


class BgmodelWarning(UserWarning):
    """Any warning of this package: a result is there, and doubtful."""

    @classmethod
    def warn(cls, sentence: str) -> None:
        """Give a warning of this family that points at the line that called the package."""
        warnings.warn(sentence, cls, stacklevel=user_level())


class RangeWarning(BgmodelWarning):
    """Evidence or a threshold lies outside the range that a circuit follows."""


class DeadlineWarning(BgmodelWarning):
    """The deadline, and not the evidence, ends trials."""


class NoiseWarning(BgmodelWarning):
    """Noise or the prior decides and not the evidence, or too few draws tell a difference."""


class CalibrationWarning(BgmodelWarning):
    """Posteriors do not match accuracies: the units of evidence, or its independence."""


class DataWarning(BgmodelWarning):
    """A table or an array looks wrong: units, copies, rounding, exchanged axes."""


class FitWarning(BgmodelWarning):
    """A fit is not identified, misses the data, or rests on too little simulation."""


class EditWarning(BgmodelWarning):
    """An edit of a circuit changes nothing, or a value of a row is implausible."""
