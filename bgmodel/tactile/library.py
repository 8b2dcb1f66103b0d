"""Contact library: contacts of the skin with every grating, solved once and cached on disk.

The tip is rotationally symmetric, so a grating's orientation matters only through the positions of
the pins: one contact per period, phase and force suffices for all yaws. Between the grid points,
phases and forces it is interpolated.
"""

import os
from contextlib import ExitStack
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

import numpy as np
import platformdirs
from scipy.ndimage import spline_filter1d
from tqdm import tqdm

from bgmodel.support.compiling import compiled
from bgmodel.support.processes import processes
from bgmodel.tactile.pressing import FORMAT, LibraryPlan, press
from circuits.arrays import Array, Singles
from circuits.errors import InputError, require
from circuits.store import Entry


@dataclass(frozen=True, eq=False)
class Library:
    """Displacements of the skin/gel interface for each period, phase and force."""

    plan: LibraryPlan
    # By period (solved phases, forces, n, n, 5): lateral x, lateral y and depth (into the body),
    # mm, and the slopes of depth along x and y; x across the bars, the apex at the centre.
    fields: dict[float, Singles]
    _splines: dict[tuple[float, float], Singles] = field(
        default_factory=dict, repr=False, init=False
    )

    def sample(
        self, period_mm: float, phase: Array, force_n: Array, points_mm: Array, pin_mm: float
    ) -> Singles:
        """Return lateral x and y of pin tips and depth of pin roots, mm, (taps, pins, 3).

        Points, (taps, pins, 2), are positions relative to the apex in the frame of the grating, x
        across the bars, mm; phases are in periods, and ``pin_mm``, the length of a pin, converts
        the slope of the interface to lateral displacement. Values outside the library raise.
        """
        known = f"must be in the library: {sorted(self.fields)}"
        require(period_mm in self.fields, "period_mm", known, period_mm)
        forces = np.asarray(force_n, dtype=float)
        low, high = self.plan.forces_n[0], self.plan.forces_n[-1]
        if np.any(forces < low) or np.any(forces > high):
            raise InputError.of("force_n", f"must be within {low:g}..{high:g}", forces)
        splines = self._pin_splines(period_mm, pin_mm)
        by_phase = phase_weights(phase, self.plan.phases if period_mm > 0 else 1)
        by_force = node_weights(forces, self.plan.forces_n)
        weights = (by_phase[:, :, None] * by_force[:, None, :]).reshape(len(forces), -1)
        reach = self.plan.kept_mm / 2 - 2 * self.plan.stored_dx_mm
        if (farthest := np.abs(points_mm).max(initial=0.0)) > reach:
            must = f"must keep pins within {reach:g} mm of the apex (kept_mm)"
            raise InputError.of("pin_mm", must, farthest)
        cells = (points_mm + self.plan.kept_mm / 2) / self.plan.stored_dx_mm - 0.5
        out = np.empty((*points_mm.shape[:2], 3), dtype=np.float32)
        gather(splines, cells, weights.astype(np.float32), out)
        return out

    def _pin_splines(self, period_mm: float, pin_mm: float) -> Singles:
        """Return spline coefficients (n, n, 3 * phases * forces) of pin tip displacements."""
        key = (period_mm, pin_mm)
        if key not in self._splines:
            half = np.moveaxis(self.fields[period_mm], -1, 0).astype(float)
            if period_mm > 0:
                half = with_mirror_images(half, self.plan.phases)
            x, y, depth, slope_x, slope_y = half
            tips = np.stack([x - pin_mm * slope_x, y - pin_mm * slope_y, depth])
            for axis in (-2, -1):
                tips = spline_filter1d(tips, axis=axis, mode="mirror")
            splines = tips.reshape(-1, *depth.shape[-2:])
            self._splines[key] = np.ascontiguousarray(splines.transpose(1, 2, 0), np.float32)
        return self._splines[key]


def with_mirror_images(half: Array, phases: int) -> Array:
    """Return all phases (5, phases, ...) from the first half period (5, phases // 2 + 1, ...).

    A grating at phase -f is the mirror image (x to -x) of the one at phase f.
    """
    image = half[:, 1 : (phases + 1) // 2][:, ::-1, :, ::-1]
    return np.concatenate([half, image * np.reshape([-1, 1, 1, -1, 1], (5, 1, 1, 1, 1))], axis=1)


def contact_library(plan: LibraryPlan | None = None, *, workers: int = 1) -> Library:
    """Load the contact library of a plan; solve and store it if it does not exist.

    The folder is that of the environment variable BGMODEL_CACHE, or the user's cache folder. The
    number of processes does not affect the result.
    """
    require(workers >= 1, "workers", "must be 1 or more", workers)
    plan = plan or LibraryPlan()
    return Library(plan, entry(plan).once(lambda: _solve_all(plan, workers)))


def to_solve(plan: LibraryPlan) -> int:
    """Return the number of contacts still to be solved; 0 if the library's file exists."""
    there = entry(plan).path.is_file()
    return 0 if there else sum(plan.solved_phases(period) for period in plan.periods_mm)


def entry(plan: LibraryPlan) -> Entry[dict[float, Singles]]:
    """Return the place of a library's fields."""
    folder = os.environ.get("BGMODEL_CACHE") or platformdirs.user_cache_dir("bgmodel")
    return Entry(
        Path(folder), f"{FORMAT}", plan.key,
        lambda fields: {f"{period!r}": values for period, values in fields.items()},
        lambda arrays: {float(period): values for period, values in arrays.items()},
        "contact",
    )  # fmt: skip


def _solve_all(plan: LibraryPlan, workers: int) -> dict[float, Singles]:
    """Press every grating at every phase, except those that are mirror images of others."""
    tasks = [(p, j / plan.phases) for p in plan.periods_mm for j in range(plan.solved_phases(p))]
    periods, phases = zip(*tasks, strict=True)
    with ExitStack() as stack:
        mapper = stack.enter_context(processes(workers)).map if workers > 1 else map
        solved = mapper(partial(press, plan), periods, phases)
        # disable=None: no progress bar if stderr is not a terminal.
        bar = tqdm(solved, total=len(tasks), desc="contact library", unit="grating", disable=None)
        results = list(bar)
    return {
        period: np.stack([r for r, p in zip(results, periods, strict=True) if p == period])
        for period in plan.periods_mm
    }


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
