"""Tactile tasks: their hypotheses, and how decoded taps become readings."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import pandas as pd

from bgmodel.support.checks import check_range
from bgmodel.support.seeds import stream
from bgmodel.tactile.likelihood import Pool
from bgmodel.tactile.networks import wrapped
from bgmodel.tactile.source import Tactile
from bgmodel.tactile.taps import warn_of_angles
from circuits.arrays import Array
from circuits.errors import DataWarning, InputError, require

TOLERANCE_DEG = 0.5
"""Largest deviation of a pair's true rotation from that of its hypothesis, degrees."""
NEAR_DEG = 0.3
"""Deviation from a task's yaw up to which a tap of a grating was meant to have it, degrees."""


@dataclass(frozen=True)
class SameDifferent(Tactile):
    """Are two gratings the same (AA) or different (AB)? Burguete et al. (2023).

    The reading is ``Psi = psi_2 - psi_1``, the difference of two decoded angles.
    """

    period_mm: float = 2.0
    """Period of the grating, mm."""
    a_deg: float = -45.0
    """Yaw of grating A, degrees; Burguete, Griffith & Lepora 2023."""
    b_deg: float = 45.0
    """Yaw of grating B, degrees; Burguete, Griffith & Lepora 2023."""

    name: ClassVar[str] = "same-different"
    main: ClassVar[str] = "period_mm"
    channels: ClassVar[int] = 2
    stimulus: ClassVar[str] = "grating"
    column: ClassVar[str] = "psi_deg"
    taps_per_reading: ClassVar[int] = 2
    names: ClassVar[tuple[str, ...]] = ("S1", "S2")
    range_deg: ClassVar[tuple[float, float]] = (-180.0, 180.0)
    circular: ClassVar[bool] = False

    def __post_init__(self) -> None:
        super().__post_init__()
        check_range(-180, 180, a_deg=self.a_deg, b_deg=self.b_deg)

    @property
    def yaws_deg(self) -> tuple[float, ...]:
        """Yaws of A and B, degrees."""
        return self.a_deg, self.b_deg

    @property
    def where(self) -> str:
        """Description of the grating, for use in messages."""
        return f"at a period of {self.period_mm:g} mm"

    def pool(self, taps: pd.DataFrame) -> list[Array]:
        """Return the decoded angles of A and of B, degrees."""
        return of_grating(taps, self.period_mm, self.yaws_deg, self.column)

    def readings(self, pool: Pool) -> list[Array]:
        """Return differences of all pairs of taps: S1 (AA, two different taps) and S2 (AB)."""
        a, b = pool
        same = a[:, None] - a[None, :]
        return [same[~np.eye(len(a), dtype=bool)], (b[:, None] - a[None, :]).ravel()]

    def reading(self, angles_deg: Sequence[float]) -> float:
        """Return the difference of two decoded angles."""
        return angles_deg[1] - angles_deg[0]


@dataclass(frozen=True)
class Orientation(Tactile):
    """Which of N evenly spaced orientations is it? The reading is the decoded orientation."""

    channels: int = 4
    """Number of orientations, 2 to 8."""
    period_mm: float = 2.0
    """Period of the grating, mm."""

    name: ClassVar[str] = "orientation"
    main: ClassVar[str] = "period_mm"
    stimulus: ClassVar[str] = "grating"
    column: ClassVar[str] = "orientation_deg"
    taps_per_reading: ClassVar[int] = 1
    range_deg: ClassVar[tuple[float, float]] = (-90.0, 90.0)
    circular: ClassVar[bool] = True

    @property
    def yaws_deg(self) -> tuple[float, ...]:
        """``-45 + 180 k / N`` degrees, within -90..90."""
        return tuple((45 + 180 * k / self.channels) % 180 - 90 for k in range(self.channels))

    @property
    def names(self) -> tuple[str, ...]:
        """Yaws as text."""
        return tuple(f"{yaw:g}" for yaw in self.yaws_deg)

    @property
    def where(self) -> str:
        """Description of the grating, for use in messages."""
        return f"at a period of {self.period_mm:g} mm"

    def pool(self, taps: pd.DataFrame) -> list[Array]:
        """Return the decoded orientations, one array per yaw, degrees."""
        return of_grating(taps, self.period_mm, self.yaws_deg, self.column)

    def readings(self, pool: Pool) -> list[Array]:
        """Return the decoded orientations unchanged."""
        return [np.asarray(part) for part in pool]

    def reading(self, angles_deg: Sequence[float]) -> float:
        """Return the decoded orientation unchanged."""
        return angles_deg[0]


@dataclass(frozen=True)
class _Edge(Tactile):
    """Task on an edge with hypotheses 0, D, ..., (N - 1) D degrees."""

    channels: int = 2
    """Number of alternatives, 2 to 8."""
    step_deg: float = 5.0
    """Angle D between neighbouring hypotheses, degrees."""

    main: ClassVar[str] = "step_deg"
    stimulus: ClassVar[str] = "edge"
    column: ClassVar[str] = "edge_deg"
    range_deg: ClassVar[tuple[float, float]] = (-180.0, 180.0)

    def __post_init__(self) -> None:
        super().__post_init__()
        most = 180 if self.channels == 2 else 360 / self.channels
        require(0 < self.step_deg <= most, "step_deg", f"must be within 0..{most:g}", self.step_deg)

    @property
    def angles_deg(self) -> Array:
        """The hypotheses, degrees."""
        return self.step_deg * np.arange(self.channels, dtype=np.float64)

    @property
    def names(self) -> tuple[str, ...]:
        """Angles as text."""
        return tuple(f"{angle:g}" for angle in self.angles_deg)

    @property
    def where(self) -> str:
        """Description of the step, for use in messages."""
        return f"in steps of {self.step_deg:g} degrees"

    def pool(self, taps: pd.DataFrame) -> list[Array]:
        """Return true and decoded yaw of every tap, one array (taps, 2), degrees.

        Taps are shuffled, in an order that depends only on their number: recordings are sorted by
        yaw, so a fold of every sixth tap would contain no two taps of nearly the same yaw.
        """
        table = columns(taps, ["yaw_deg", self.column], "an edge").to_numpy(dtype=np.float64)
        return [table[stream(0, "order of taps").permutation(len(table))]]


class EdgeTurn(_Edge):
    """Rotation of an edge between two taps: 0, D, 2 D and so on.

    With two hypotheses the question is whether it was rotated at all. The reading is the difference
    of two decoded yaws.
    """

    name: ClassVar[str] = "edge-turn"
    taps_per_reading: ClassVar[int] = 2
    circular: ClassVar[bool] = False

    def readings(self, pool: Pool) -> list[Array]:
        """Return, per hypothesis, decoded differences of all pairs with that true difference."""
        true, read = pool[0][np.argsort(pool[0][:, 0], kind="stable")].T
        around = np.concatenate([true - 360, true, true + 360])
        differences: list[Array] = []
        for angle in self.angles_deg:
            # For each tap, the other taps rotated by this angle, within the tolerance.
            first = np.searchsorted(around, true + angle - TOLERANCE_DEG, side="right")
            count = np.searchsorted(around, true + angle + TOLERANCE_DEG) - first
            one = np.repeat(np.arange(len(true)), count)
            ahead = np.arange(len(one)) - np.repeat(count.cumsum() - count, count)
            other = (np.repeat(first, count) + ahead) % len(true)
            pairs = one != other
            turned = read[other[pairs]] - read[one[pairs]]
            differences.append(np.asarray(wrapped(turned, 360), dtype=np.float64))
        return differences

    def reading(self, angles_deg: Sequence[float]) -> float:
        """Return the difference of the two decoded yaws."""
        return float(wrapped(np.float64(angles_deg[1] - angles_deg[0]), 360))  # type: ignore[arg-type]


class EdgeDirection(_Edge):
    """Direction of an edge, one of N that are D degrees apart.

    The reading is the decoded yaw relative to the first direction. Every tap is used for every
    hypothesis, by rotating the reference frame so that its true yaw is that of the hypothesis.
    This assumes that decoding errors are alike in all directions.
    """

    name: ClassVar[str] = "edge-direction"
    taps_per_reading: ClassVar[int] = 1
    circular: ClassVar[bool] = True

    def readings(self, pool: Pool) -> list[Array]:
        """Return decoded directions of all taps, rotated to the direction of each hypothesis."""
        true, read = pool[0].T
        return [np.asarray(wrapped(read - true + angle, 360)) for angle in self.angles_deg]

    def reading(self, angles_deg: Sequence[float]) -> float:
        """Return the decoded yaw relative to the first direction."""
        return angles_deg[0]


def of_grating(
    taps: pd.DataFrame, period_mm: float, yaws_deg: tuple[float, ...], column: str
) -> list[Array]:
    """Return a column of the decoded taps of one grating, one array per yaw."""
    table = columns(taps, ["period_mm", "yaw_deg", column], "gratings")
    here = table[np.isclose(table["period_mm"], period_mm)]
    if here.empty:
        known = sorted(float(period) for period in taps["period_mm"].unique())
        raise InputError.of("period_mm", f"must be one of {known}", period_mm)
    pool = []
    for yaw in yaws_deg:
        # The tolerance allows for rounding in the table.
        values = here.loc[np.isclose(here["yaw_deg"], yaw, atol=0.01), column]
        near = int((abs(here["yaw_deg"] - yaw) < NEAR_DEG).sum())
        if 0 < len(values) < 0.9 * near:
            DataWarning.warn(
                f"yaw_deg must be within 0.01 degrees of {yaw:g}, as in {len(values)} of the "
                f"{near} taps within {NEAR_DEG:g} degrees: round it, or the others are not used"
            )
        if values.empty:
            wanted = " ".join(f"{each:g}" for each in yaws_deg)
            raise InputError(
                f"there are no taps of period {period_mm:g} mm at a yaw of {yaw:g} degrees: create "
                f"them with `bgmodel touch simulate --save held_out.npz --periods-mm {period_mm:g} "
                f"--yaw-deg {wanted}`, and decode them",
                "taps",
            )
        pool.append(values.to_numpy(dtype=np.float64))
    return pool


def columns(taps: pd.DataFrame, wanted: list[str], stimulus: str) -> pd.DataFrame:
    """Return columns of decoded taps as numbers; ValueError if it has no such columns or gaps."""
    lacking = [name for name in wanted if name not in taps]
    if lacking:
        raise InputError(
            f"this task needs a table (taps) of decoded taps of {stimulus}, with "
            f"{', '.join(wanted)}: the table has no {', '.join(lacking)}",
            "taps",
        )
    table: pd.DataFrame = taps[wanted].apply(pd.to_numeric, errors="coerce")
    wrong = ~np.isfinite(table.to_numpy(dtype=np.float64))
    for row, column in np.argwhere(wrong)[:1]:
        must = f"must be finite in every tap, {wrong[:, column].sum()} are not: first row {row}"
        raise InputError.of(wanted[column], must, taps[wanted[column]].iloc[row])
    warn_of_angles(table, wanted[-1])
    return table
