"""The tactile tasks: questions about taps, and how decoded taps become readings."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar, Protocol

import numpy as np

from bgmodel.support.arrays import Array
from bgmodel.support.seeds import stream
from bgmodel.tactile.likelihood import Pool
from bgmodel.tactile.networks import wrapped
from circuits.errors import InputError, require

if TYPE_CHECKING:
    import pandas as pd

TOLERANCE_DEG = 0.5
"""Largest distance of a pair's true turn from the one that is asked, degrees."""
MOST_HYPOTHESES = 8


class Task(Protocol):
    """A question about taps: its hypotheses, and how decoded taps become readings."""

    stimulus: ClassVar[str]
    """What must be tapped, a name in ``taps.STIMULI``."""
    column: ClassVar[str]
    """What is read of a decoded tap."""
    taps: ClassVar[int]
    """Taps that make one reading."""
    range_deg: ClassVar[tuple[float, float]]
    circular: ClassVar[bool]

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the hypotheses."""
        ...

    @property
    def where(self) -> str:
        """What the taps are of, for a sentence."""
        ...

    def pool(self, taps: pd.DataFrame) -> list[Array]:
        """Return what the task needs of decoded taps, an array per kind of tap, a row per tap."""
        ...

    def readings(self, pool: Pool) -> list[Array]:
        """Turn a pool, or a part of one, into readings, an array per hypothesis, degrees."""
        ...

    def reading(self, angles_deg: Sequence[float]) -> float:
        """Turn the decoded angles of ``taps`` taps into one reading, degrees."""
        ...


@dataclass(frozen=True)
class SameDifferent:
    """Whether two gratings are the same, AA, or different, AB (Burguete et al. 2023).

    The reading is ``Psi = psi_2 - psi_1``, the difference of two decoded angles.
    """

    period_mm: float = 2.0
    """Period of the grating, mm."""
    a_deg: float = -45.0
    """Yaw of grating A, degrees; Burguete, Griffith & Lepora 2023."""
    b_deg: float = 45.0
    """Yaw of grating B, degrees; Burguete, Griffith & Lepora 2023."""

    stimulus: ClassVar[str] = "grating"
    column: ClassVar[str] = "psi_deg"
    taps: ClassVar[int] = 2
    names: ClassVar[tuple[str, ...]] = ("S1", "S2")
    range_deg: ClassVar[tuple[float, float]] = (-180.0, 180.0)
    circular: ClassVar[bool] = False

    @property
    def yaws_deg(self) -> tuple[float, ...]:
        """The two yaws."""
        return self.a_deg, self.b_deg

    @property
    def where(self) -> str:
        """The grating."""
        return f"at a period of {self.period_mm:g} mm"

    def pool(self, taps: pd.DataFrame) -> list[Array]:
        """Return the decoded angles of A and of B."""
        return of_grating(taps, self.period_mm, self.yaws_deg, self.column)

    def readings(self, pool: Pool) -> list[Array]:
        """Return the differences of all pairs of taps: S1 (AA, never a tap with itself), S2."""
        a, b = pool
        same = a[:, None] - a[None, :]
        return [same[~np.eye(len(a), dtype=bool)], (b[:, None] - a[None, :]).ravel()]

    def reading(self, angles_deg: Sequence[float]) -> float:
        """Return the difference of two decoded angles."""
        return angles_deg[1] - angles_deg[0]


@dataclass(frozen=True)
class Orientations:
    """Which of N evenly spaced orientations is it?  The reading is the decoded orientation."""

    count: int = 4
    """Number of orientations, 2 to 8."""
    period_mm: float = 2.0
    """Period of the grating, mm."""

    stimulus: ClassVar[str] = "grating"
    column: ClassVar[str] = "orientation_deg"
    taps: ClassVar[int] = 1
    range_deg: ClassVar[tuple[float, float]] = (-90.0, 90.0)
    circular: ClassVar[bool] = True

    def __post_init__(self) -> None:
        _check_count(self.count)

    @property
    def yaws_deg(self) -> tuple[float, ...]:
        """``-45 + 180 k / N`` degrees, within -90..90."""
        return tuple((45 + 180 * k / self.count) % 180 - 90 for k in range(self.count))

    @property
    def names(self) -> tuple[str, ...]:
        """The yaws as text."""
        return tuple(f"{yaw:g}" for yaw in self.yaws_deg)

    @property
    def where(self) -> str:
        """The grating."""
        return f"at a period of {self.period_mm:g} mm"

    def pool(self, taps: pd.DataFrame) -> list[Array]:
        """Return the decoded orientations, an array per yaw."""
        return of_grating(taps, self.period_mm, self.yaws_deg, self.column)

    def readings(self, pool: Pool) -> list[Array]:
        """Return the decoded orientations as they are."""
        return [np.asarray(part) for part in pool]

    def reading(self, angles_deg: Sequence[float]) -> float:
        """Return the decoded orientation as it is."""
        return angles_deg[0]


@dataclass(frozen=True)
class _Edge:
    """A question about an edge, with hypotheses 0, D, ..., (N - 1) D degrees."""

    count: int = 2
    """Number of hypotheses, 2 to 8."""
    step_deg: float = 5.0
    """Degrees between two neighbouring hypotheses, D."""

    stimulus: ClassVar[str] = "edge"
    column: ClassVar[str] = "edge_deg"
    range_deg: ClassVar[tuple[float, float]] = (-180.0, 180.0)

    def __post_init__(self) -> None:
        _check_count(self.count)
        most = 180 if self.count == 2 else 360 / self.count
        require(0 < self.step_deg <= most, "step_deg", f"must lie in 0..{most:g}", self.step_deg)

    @property
    def angles_deg(self) -> Array:
        """The hypotheses, degrees."""
        return self.step_deg * np.arange(self.count, dtype=np.float64)

    @property
    def names(self) -> tuple[str, ...]:
        """The angles as text."""
        return tuple(f"{angle:g}" for angle in self.angles_deg)

    @property
    def where(self) -> str:
        """The step."""
        return f"in steps of {self.step_deg:g} degrees"

    def pool(self, taps: pd.DataFrame) -> list[Array]:
        """Return true and decoded yaw of every tap, one array (taps, 2), degrees.

        In a random order that depends on nothing but their number: recordings are sorted by yaw,
        and a fold of every sixth tap would then hold no two taps of nearly the same yaw.
        """
        table = columns(taps, ["yaw_deg", self.column], "an edge").to_numpy(dtype=np.float64)
        return [table[stream(0, "order of taps").permutation(len(table))]]


class EdgeTurn(_Edge):
    """By how much an edge was turned between two taps: not at all, by D, by 2 D and so on.

    With two hypotheses it asks whether two edges are the same. The reading is the difference of
    two decoded yaws.
    """

    taps: ClassVar[int] = 2
    circular: ClassVar[bool] = False

    def readings(self, pool: Pool) -> list[Array]:
        """Return the decoded differences of all pairs of taps with each true difference."""
        true, read = pool[0][np.argsort(pool[0][:, 0], kind="stable")].T
        around = np.concatenate([true - 360, true, true + 360])
        found: list[Array] = []
        for angle in self.angles_deg:
            # Of each tap, the others that lie within the tolerance of the angle ahead of it.
            first = np.searchsorted(around, true + angle - TOLERANCE_DEG, side="right")
            count = np.searchsorted(around, true + angle + TOLERANCE_DEG) - first
            one = np.repeat(np.arange(len(true)), count)
            ahead = np.arange(len(one)) - np.repeat(count.cumsum() - count, count)
            other = (np.repeat(first, count) + ahead) % len(true)
            pairs = one != other
            turned = read[other[pairs]] - read[one[pairs]]
            found.append(np.asarray(wrapped(turned, 360), dtype=np.float64))
        return found

    def reading(self, angles_deg: Sequence[float]) -> float:
        """Return by how much the decoded yaw turned."""
        return float(wrapped(np.float64(angles_deg[1] - angles_deg[0]), 360))  # type: ignore[arg-type]


class EdgeDirection(_Edge):
    """Which of N directions, D degrees apart, an edge has.

    The reading is the decoded yaw as seen from the first direction. Every tap serves for every
    hypothesis: the frame of its hypotheses is turned so that its true yaw is the one asked, which
    assumes that the sensor reads all directions alike.
    """

    taps: ClassVar[int] = 1
    circular: ClassVar[bool] = True

    def readings(self, pool: Pool) -> list[Array]:
        """Return the decoded directions of all taps, as if each had the direction asked."""
        true, read = pool[0].T
        return [np.asarray(wrapped(read - true + angle, 360)) for angle in self.angles_deg]

    def reading(self, angles_deg: Sequence[float]) -> float:
        """Return the decoded yaw, where the first direction is 0 degrees."""
        return angles_deg[0]


def of_grating(
    taps: pd.DataFrame, period_mm: float, yaws_deg: tuple[float, ...], column: str
) -> list[Array]:
    """Return a column of the decoded taps of one grating, an array per yaw.

    Raises
    ------
    ValueError
        If there is no such grating among the taps, or no tap at a yaw: with the command that makes
        them.
    """
    table = columns(taps, ["period_mm", "yaw_deg", column], "gratings")
    here = table[np.isclose(table["period_mm"], period_mm)]
    if here.empty:
        known = sorted(float(period) for period in taps["period_mm"].unique())
        raise InputError.of("period_mm", f"must be one of {known}", period_mm)
    pool = []
    for yaw in yaws_deg:
        # Within the rounding of the table.
        values = here.loc[np.isclose(here["yaw_deg"], yaw, atol=0.01), column]
        if values.empty:
            wanted = " ".join(f"{each:g}" for each in yaws_deg)
            raise InputError(
                f"there are no taps of period {period_mm:g} mm at a yaw of {yaw:g} degrees: make "
                f"them with `bgmodel simulate held_out.npz --periods-mm {period_mm:g} --yaw-deg "
                f"{wanted}`, and decode them",
                "taps",
            )
        pool.append(values.to_numpy(dtype=np.float64))
    return pool


def columns(taps: pd.DataFrame, wanted: list[str], stimulus: str) -> pd.DataFrame:
    """Return columns of a table of decoded taps; ValueError if it is not one of that stimulus."""
    lacking = [name for name in wanted if name not in taps]
    if lacking:
        raise InputError(
            f"this task needs decoded taps of {stimulus}, with {', '.join(wanted)}: "
            f"the table has no {', '.join(lacking)}",
            "taps",
        )
    return taps[wanted]


def _check_count(count: int) -> None:
    within = 2 <= count <= MOST_HYPOTHESES
    require(within, "count", f"must be 2 to {MOST_HYPOTHESES} hypotheses", count)


TASKS: dict[str, Callable[[int, float, float], Task]] = {
    "same-different": lambda count, period_mm, step_deg: SameDifferent(period_mm),
    "orientation": lambda count, period_mm, step_deg: Orientations(count, period_mm),
    "edge-turn": lambda count, period_mm, step_deg: EdgeTurn(count, step_deg),
    "edge-direction": lambda count, period_mm, step_deg: EdgeDirection(count, step_deg),
}
"""Tasks by name, made from a number of hypotheses, the period of a grating, mm, and a step."""
