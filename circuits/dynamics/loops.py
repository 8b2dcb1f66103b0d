"""Loops of nuclei that amplify themselves, which errors about rates that run away name."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from circuits.arrays import Array
from circuits.declaration.rows import USUAL_HZ
from circuits.dynamics.wiring import Wiring

STEP, MOST_STEPS = 0.1, 400
"""Step, in time constants common to all nuclei, and number of steps in which rates run away."""
MOST_NUCLEI = 6


def amplifying(wiring: Wiring, x: Array) -> tuple[list[str], float]:
    """Return the loop of nuclei that amplifies itself most at a state x (blocks,), and its gain.

    The gain is the largest eigenvalue of the product of its pathways' slopes, nats per nat, over
    all patterns of channels. Above 1 the loop runs away unless others hold it. Without loops: 0.
    """
    names = [row.name for row in wiring.circuit.populations]
    slope = wiring.units_slope(wiring.deliver @ wiring.rates(x) + wiring.constant)
    direct = (wiring.weight * slope) @ (wiring.deliver * wiring.rates_slope(x))
    loops = [([names[i] for i in loop], gain) for loop, gain in _loops(wiring, direct)]
    return max(loops, key=lambda pair: pair[1], default=([], 0.0))


def loop_advice(wiring: Wiring, x: Array) -> str:
    """Return the end of a message that names a loop of gain above 1, and its cure, or ""."""
    names, gain = amplifying(wiring, x)
    loop = " -> ".join([*names, *names[:1]])
    text = f": the loop {loop} has a gain of {gain:.3g}, more than 1: weaken one of its pathways"
    return text if gain > 1 else ""


def runaway(wiring: Wiring, drive: Array, what: str) -> ValueError:
    """Return an error with the loop that runs away under a drive (columns,), at ``USUAL_HZ``."""
    outside = wiring.drive(drive)
    x = wiring.bias + outside
    for _ in range(MOST_STEPS):
        rates = wiring.rates(x)
        if rates.max() > USUAL_HZ:
            break
        x = x + STEP * (outside + wiring.inputs(wiring.deliver @ rates + wiring.constant) - x)
    return ValueError(f"{what}{loop_advice(wiring, x)}")


def _loops(wiring: Wiring, direct: Array) -> Iterator[tuple[list[int], float]]:
    """Yield every loop, its first nucleus first, with its gain."""
    blocks = [wiring.blocks_of(row.name) for row in wiring.circuit.populations]
    paths = [([i], np.eye(len(of_nucleus))) for i, of_nucleus in enumerate(blocks)]
    while paths:
        path, product = paths.pop()
        for i in range(path[0], len(blocks)):
            onward = direct[np.ix_(blocks[i], blocks[path[-1]])] @ product
            if i == path[0] and onward.any():
                yield path, float(np.linalg.eigvals(onward).real.max())
            elif i not in path and len(path) < MOST_NUCLEI and onward.any():
                paths.append(([*path, i], onward))
