"""The tactile tasks: from decoded taps to Evidence, with likelihoods fitted on other taps."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from importlib import resources
from typing import ClassVar, Protocol

import numpy as np
import numpy.typing as npt
import pandas as pd

from bgmodel.evidence import Evidence
from bgmodel.support.arrays import Array
from bgmodel.support.checks import whole
from bgmodel.support.seeds import generator
from bgmodel.tactile.likelihood import Density, Likelihood, Pool, fit_likelihood
from circuits.errors import CalibrationWarning, InputError, require, user_level

FOLDS = 6
STEP_MS = 500.0


class Task(Protocol):
    """A question about taps: which column answers it, and how taps become readings."""

    column: ClassVar[str]
    range_deg: ClassVar[tuple[float, float]]
    circular: ClassVar[bool]

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the hypotheses."""
        ...

    @property
    def yaws_deg(self) -> tuple[float, ...]:
        """Yaws of the taps that the readings are made of."""
        ...

    def readings(self, pool: Pool) -> list[Array]:
        """Turn decoded angles, one array a yaw, into readings, one array a hypothesis."""
        ...


@dataclass(frozen=True)
class SameDifferent:
    """Whether two gratings are the same, AA, or different, AB (Burguete et al. 2023).

    The reading is ``Psi = psi_2 - psi_1``, the difference of two decoded angles.
    """

    a_deg: float = -45.0
    """Yaw of grating A, degrees; Burguete, Griffith & Lepora 2023."""
    b_deg: float = 45.0
    """Yaw of grating B, degrees; Burguete, Griffith & Lepora 2023."""

    names: ClassVar[tuple[str, ...]] = ("S1", "S2")
    column: ClassVar[str] = "psi_deg"
    range_deg: ClassVar[tuple[float, float]] = (-180.0, 180.0)
    circular: ClassVar[bool] = False

    @property
    def yaws_deg(self) -> tuple[float, ...]:
        """The two yaws."""
        return self.a_deg, self.b_deg

    def readings(self, pool: Pool) -> list[Array]:
        """Return the differences of all pairs of taps: S1 (AA, never a tap with itself), S2."""
        a, b = pool
        same = a[:, None] - a[None, :]
        return [same[~np.eye(len(a), dtype=bool)], (b[:, None] - a[None, :]).ravel()]


@dataclass(frozen=True)
class Orientations:
    """Which of N evenly spaced orientations is it?  The reading is the decoded orientation."""

    count: int = 4
    """Number of orientations, 2 to 8."""

    column: ClassVar[str] = "orientation_deg"
    range_deg: ClassVar[tuple[float, float]] = (-90.0, 90.0)
    circular: ClassVar[bool] = True

    def __post_init__(self) -> None:
        require(2 <= self.count <= 8, "count", "must be 2 to 8 orientations", self.count)

    @property
    def yaws_deg(self) -> tuple[float, ...]:
        """``-45 + 180 k / N`` degrees, within -90..90."""
        return tuple((45 + 180 * k / self.count) % 180 - 90 for k in range(self.count))

    @property
    def names(self) -> tuple[str, ...]:
        """The yaws as text."""
        return tuple(f"{yaw:g}" for yaw in self.yaws_deg)

    def readings(self, pool: Pool) -> list[Array]:
        """Return the decoded orientations as they are."""
        return [np.asarray(part) for part in pool]


@dataclass(frozen=True)
class Source:
    """All readings that a set of held-out taps can give, and what they say.

    Parameters
    ----------
    log_likelihood : list of arrays (readings, hypotheses), nats
        One array a true hypothesis.
    names : tuple of str
        Names of the hypotheses.
    likelihood : Likelihood
        Fitted on other taps.
    """

    log_likelihood: list[Array]
    names: tuple[str, ...]
    likelihood: Likelihood

    def draw(
        self,
        trials: int,
        steps: int,
        *,
        rng: np.random.Generator | int,
        prior: npt.ArrayLike | None = None,
        step_ms: float = STEP_MS,
    ) -> Evidence:
        """Draw trials whose readings are independent samples, with replacement.

        Parameters
        ----------
        trials, steps : int
            Truth is balanced: trial k belongs to hypothesis k mod N.  Its readings are the same
            however many trials follow.
        rng : numpy.random.Generator or int
            The source of every random number, or a seed.
        prior : array (hypotheses,), optional
            What the decider believes; the draw stays balanced.
        step_ms : float
            Time a tap takes, ms; 500 is assumed.
        """
        trials, steps = whole("trials", trials, 1), whole("steps", steps, 1)
        rng = generator(rng)
        count = len(self.names)
        truth = np.arange(trials) % count
        # Filled trial by trial, one number a reading: a trial never sees the ones after it.
        place = rng.random((trials, steps))
        values = np.empty((trials, steps, count), dtype=np.float64)
        for i, table in enumerate(self.log_likelihood):
            values[i::count] = table[(place[i::count] * len(table)).astype(np.intp)]
        return Evidence(
            values,
            truth,
            prior,  # type: ignore[arg-type]
            step_ms=step_ms,
            baseline=self.baseline,
        )

    def warn_if_silent(self, period_mm: float) -> None:
        """Warn where the decoder does not resolve the hypotheses: every reading says nothing.

        Parameters
        ----------
        period_mm : float
            Period of the grating, mm, for the sentence.
        """
        if self.likelihood.shrink == 0:
            warnings.warn(
                f"at a period of {period_mm:g} mm the decoder tells none of the "
                f"{len(self.names)} hypotheses apart: saying nothing predicts held-out taps best, "
                "so that every reading is worth 0 nats and every choice is a guess",
                CalibrationWarning,
                stacklevel=user_level(),
            )

    @property
    def baseline(self) -> float:
        """Mean of what a reading says, over hypotheses, all true ones alike, nats."""
        return float(np.mean([part.mean() for part in self.log_likelihood]))

    @cached_property
    def log_ratios(self) -> tuple[Array, ...]:
        """Log-likelihood ratio S2 : S1 of every reading under S1 and under S2, nats."""
        if len(self.names) != 2:
            raise InputError(
                f"log ratios need 2 hypotheses, this task has {len(self.names)}", "names"
            )
        return tuple(values[:, 1] - values[:, 0] for values in self.log_likelihood)


@dataclass(frozen=True)
class Folds:
    """Readings of several folds of taps, drawn in turn: trial k is of fold k mod their number.

    Trials are many, taps are few: an interval over the trials of one fold says nothing of other
    taps. One over ``groups`` does.

    Parameters
    ----------
    sources : sequence of Source
        One per fold, as from ``source``.
    """

    sources: Sequence[Source]

    def draw(
        self, trials: int, steps: int, *, rng: np.random.Generator, step_ms: float = STEP_MS
    ) -> Evidence:
        """Draw trials as ``Source.draw`` does, from each fold in turn.

        Parameters
        ----------
        trials, steps, rng, step_ms :
            As for ``Source.draw``; trials must be as many as there are folds, or more.
        """
        count = len(self.sources)
        require(trials >= count, "trials", f"must be {count} or more, one per fold", trials)
        values = np.empty((trials, steps, len(self.sources[0].names)))
        truth = np.empty(trials, dtype=np.int64)
        for fold, readings in enumerate(self.sources):
            part = readings.draw(len(truth[fold::count]), steps, rng=rng, step_ms=step_ms)
            values[fold::count] = part.log_likelihood
            truth[fold::count] = np.asarray(part.truth)
        baseline = float(np.mean([readings.baseline for readings in self.sources]))
        return Evidence(values, truth, step_ms=step_ms, baseline=baseline)

    def groups(self, trials: int) -> npt.NDArray[np.intp]:
        """Return the fold of each trial, (trials,), for the bootstrap of ``comparison.compare``."""
        return np.arange(trials) % len(self.sources)


def held_out_taps() -> pd.DataFrame:
    """Return the decoded held-out taps that ship with the package.

    One row a tap: period_mm, yaw_deg, psi_deg (linear head), orientation_deg (double-angle head).
    ``bgmodel.support.files.read_provenance`` of the file tells how it was made.
    """
    with resources.as_file(resources.files("bgmodel.data") / "held_out_taps.parquet") as path:
        return pd.read_parquet(path).astype("float64")


def source(
    taps: pd.DataFrame,
    task: Task,
    *,
    period_mm: float,
    fold: int,
    density: Density | None = None,
) -> Source:
    """Fit likelihoods on five folds of the held-out taps; return the readings of the sixth.

    Parameters
    ----------
    taps : DataFrame
        As from ``held_out_taps``.
    task : Task
        ``SameDifferent()`` or ``Orientations(n)``.
    period_mm : float
        Period of the grating, mm.
    fold : int
        Which of the six folds to score on, 0..5; tap k of a stimulus is in fold k mod 6.
    density : Density
        How likelihoods are estimated.

    Raises
    ------
    ValueError
        If there are no such taps, or the fold does not exist.
    """
    require(0 <= fold < FOLDS, "fold", f"must be 0..{FOLDS - 1}", fold)
    pool = tap_pool(taps, task, period_mm)
    scored = [np.arange(len(part)) % FOLDS == fold for part in pool]
    fitted = [part[~mask] for part, mask in zip(pool, scored, strict=True)]
    likelihood = fit_likelihood(
        fitted, task.readings, task.range_deg, circular=task.circular, density=density
    )
    rest = task.readings([part[mask] for part, mask in zip(pool, scored, strict=True)])
    return Source([likelihood(x) for x in rest], task.names, likelihood)


def folds(taps: pd.DataFrame, task: Task, *, period_mm: float) -> Folds:
    """Return the readings of all six folds of the held-out taps, drawn in turn.

    Parameters
    ----------
    taps, task, period_mm :
        As for ``source``.
    """
    return Folds([source(taps, task, period_mm=period_mm, fold=fold) for fold in range(FOLDS)])


def tap_pool(taps: pd.DataFrame, task: Task, period_mm: float) -> list[Array]:
    """Return the decoded angles of one grating, one array a yaw of the task, degrees."""
    here = taps[np.isclose(taps["period_mm"], period_mm)]
    if here.empty:
        known = sorted(float(period) for period in taps["period_mm"].unique())
        raise InputError.of("period_mm", f"must be one of {known}", period_mm)
    pool = []
    for yaw in task.yaws_deg:
        # Within the rounding of the table.
        values = here.loc[np.isclose(here["yaw_deg"], yaw, atol=0.01), task.column]
        if values.empty:
            raise InputError(
                f"there are no taps of period {period_mm} mm at yaw {yaw:g} degrees", "period_mm"
            )
        pool.append(values.to_numpy(dtype=np.float64))
    return pool
