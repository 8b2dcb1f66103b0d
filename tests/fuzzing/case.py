"""One input, and whether it must be refused."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

Rng = np.random.Generator


@dataclass
class Case:
    """One input.

    Parameters
    ----------
    valid : bool
        Whether it must give a result, or one sentence.
    arguments : list of str, optional
        Of a command, if it is one.
    call : callable, optional
        Else what to call; a broken one must raise ValueError.
    check : callable, optional
        Holds the result of a valid one to an oracle: gets what ``call`` returned, or nothing.
    words : tuple of str
        The sentence on a broken one must hold one of these: it is refused for what is broken.
    """

    valid: bool
    arguments: list[str] | None = None
    call: Callable[[], Any] | None = None
    check: Callable[..., None] | None = None
    words: tuple[str, ...] = ()


def pick(rng: Rng, *values: Any) -> Any:
    """Return one of the values."""
    return values[int(rng.integers(len(values)))]
