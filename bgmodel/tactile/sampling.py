"""Interpolation between the grid points, phases and forces of the contact library."""

import numpy as np

from bgmodel.support.arrays import Array, Singles
from bgmodel.support.compiling import compiled


def phase_weights(phase: Array, count: int) -> Array:
    """Return weights (taps, count) of equally spaced phases for trigonometric interpolation.

    Exact up to harmonic (count - 1) // 2 of the period; the skin strongly attenuates harmonics from
    the second on.
    """
    turn = 2 * np.pi * (np.asarray(phase)[:, None] - np.arange(count) / count)
    weights = np.ones_like(turn)
    for harmonic in range(1, (count + 1) // 2):
        weights += 2 * np.cos(harmonic * turn)
    if count % 2 == 0:
        weights += np.cos(count // 2 * turn)
    return weights / count


def node_weights(value: Array, nodes: tuple[float, ...]) -> Array:
    """Return weights (taps, nodes) of the Lagrange polynomial through `nodes`."""
    value = np.asarray(value, dtype=float)
    weights = np.ones((value.size, len(nodes)))
    for i, node in enumerate(nodes):
        for other in nodes[:i] + nodes[i + 1 :]:
            weights[:, i] *= (value - other) / (node - other)
    return weights


@compiled
def gather(
    coefficients: Singles, points: Array, weights: Singles, out: Singles
) -> None:  # pragma: no cover - compiled
    """Evaluate cubic splines at points well inside their grid and sum them with weights.

    Coefficients, (n, n, values * blends), have all blends of a value adjacent; points, (taps, pins,
    2), are in cells from the centre of the first; weights are (taps, blends). ``out``, (taps, pins,
    values), is overwritten.
    """
    width = coefficients.shape[2]
    blends = weights.shape[1]
    along = np.empty((2, 4), np.float32)
    cell = np.empty(2, np.int64)
    sums = np.empty(width, np.float32)
    for tap in range(points.shape[0]):
        for pin in range(points.shape[1]):
            for axis in range(2):
                place = points[tap, pin, axis]
                cell[axis] = int(np.floor(place))
                t = place - cell[axis]
                along[axis, 0] = (1 - t) ** 3 / 6
                along[axis, 1] = (4 - 6 * t * t + 3 * t**3) / 6
                along[axis, 2] = (1 + 3 * t + 3 * t * t - 3 * t**3) / 6
                along[axis, 3] = t**3 / 6
            sums[:] = 0
            for i in range(4):
                for j in range(4):
                    share = along[0, i] * along[1, j]
                    row = coefficients[cell[0] + i - 1, cell[1] + j - 1]
                    for c in range(width):
                        sums[c] += share * row[c]
            for value in range(out.shape[2]):
                total = np.float32(0)
                for blend in range(blends):
                    total += weights[tap, blend] * sums[value * blends + blend]
                out[tap, pin, value] = total
