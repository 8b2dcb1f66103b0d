"""Random-number streams by name, so that no part of a study shifts the noise of another.

The noise of a circuit's cells, by seed and trial, is drawn in ``circuits.dynamics.noise``.
"""

from __future__ import annotations

import hashlib
import numbers

import numpy as np

from circuits.errors import InputError


def stream(seed: int, *names: object) -> np.random.Generator:
    """Return the generator for ``seed`` and a path of names.

    The same seed and names give the same numbers whatever else is drawn, in any order and any
    number of processes.

    Parameters
    ----------
    seed : int
        A non-negative whole number.
    names : object
        Anything with a stable ``str``: ``stream(7, "learn", period_mm, fold)``.

    Raises
    ------
    ValueError
        If ``seed`` is negative or not whole.
    """
    if not isinstance(seed, numbers.Real) or seed < 0 or seed % 1:
        raise InputError.of("seed", "must be a whole number >= 0", seed)
    path = "\x1f".join(str(name) for name in names).encode()
    words = np.frombuffer(hashlib.sha256(path).digest(), dtype=np.uint32)
    return np.random.default_rng([int(seed), *(int(word) for word in words)])


def generator(rng: np.random.Generator | int, name: str = "rng") -> np.random.Generator:
    """Return a generator unchanged, or that of a seed; ``name`` is the name of the argument."""
    if isinstance(rng, np.random.Generator):
        return rng
    if isinstance(rng, numbers.Real):
        return stream(rng)
    raise InputError.of(
        name, "must be a numpy Generator, as from stream(seed), or a seed, a whole number >= 0", rng
    )
