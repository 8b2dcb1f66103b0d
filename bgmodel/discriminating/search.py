"""The search over a space: complete if it is small, otherwise by differential evolution."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

Place = tuple[int, ...]
POPULATION = 16
"""Places with which a search begins, spread evenly (Sobol)."""


def search(
    sizes: Sequence[int], score: Callable[[Place], float], *, evaluations: int, seed: int
) -> dict[Place, float]:
    """Return the score of each place of a grid that was tried; the best is the largest.

    Differential evolution (Storn & Price 1997; ``scipy.optimize``) begins with a Sobol sequence,
    which spreads the first places over the space, so that they are a map of it, and needs neither
    gradients nor scores without noise.
    """
    known: dict[Place, float] = {}
    if np.prod(sizes) <= evaluations:
        for place in np.ndindex(*sizes):
            known[place] = score(place)
        return known
    from scipy.optimize import differential_evolution
    from scipy.stats import qmc

    def cost(where: np.ndarray) -> float:
        place = tuple(round(float(x)) for x in where)
        if place not in known and len(known) < evaluations:
            known[place] = score(place)
        return -known.get(place, -np.inf) if np.isfinite(known.get(place, -np.inf)) else 1e9

    unit = qmc.Sobol(len(sizes), rng=np.random.default_rng(seed)).random(POPULATION)
    differential_evolution(
        cost, [(0, size - 1 + 1e-9) for size in sizes], integrality=np.ones(len(sizes), dtype=bool),
        init=np.floor(unit * np.asarray(sizes)), maxiter=50, polish=False, tol=0,
        callback=lambda *_: len(known) >= evaluations, rng=np.random.default_rng(seed),
    )  # fmt: skip
    return known
