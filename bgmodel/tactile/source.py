"""Readings: log-likelihoods of decoded taps under each hypothesis, fitted on other taps."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from importlib import resources
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import numpy.typing as npt
import pandas as pd

from bgmodel.evidence import Evidence
from bgmodel.support.checks import check_range, whole
from bgmodel.support.files import checksum, read_provenance, read_table
from bgmodel.support.seeds import generator
from bgmodel.tactile.likelihood import Pool, TabulatedLikelihood, check_fitted, fit_likelihood
from bgmodel.tactile.taps import warn_of_copied_taps
from bgmodel.task import Drawn
from circuits.arrays import Array
from circuits.errors import CalibrationWarning, DataWarning, InputError, require

FOLDS = 6
MOST_HYPOTHESES = 8
STEP_MS = 500.0
SILENT_NATS = 0.1
"""Mean log-likelihood ratio of a reading below which a task is considered uninformative, nats."""
SHIPPED = Path(str(resources.files("bgmodel") / "data" / "held_out_taps.parquet"))
"""Decoded taps included in the package."""


@dataclass(frozen=True)
class Source:
    """All possible readings from a set of held-out taps, with their log-likelihoods."""

    log_likelihood: list[Array]  # per true hypothesis (readings, hypotheses), nats
    names: tuple[str, ...]
    likelihood: TabulatedLikelihood  # fitted on other taps
    where: str = "here"  # description of the stimulus, for use in messages

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

        True hypotheses are balanced, k mod N in trial k, whatever the prior of the decision maker.
        Readings of a trial do not depend on the number of trials. A time of 500 ms per tap is
        assumed.
        """
        trials, steps = whole("trials", trials, 1), whole("steps", steps, 1)
        rng = generator(rng)
        count = len(self.names)
        truth = np.arange(trials) % count
        # One number per reading, trial by trial: a trial does not depend on later ones.
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

    def warn_if_silent(self) -> None:
        """Warn if readings are uninformative: the decoder does not distinguish the hypotheses."""
        if self.silent:
            CalibrationWarning.warn(
                f"the decoder does not distinguish the {len(self.names)} hypotheses {self.where}: "
                f"a reading carries less than {SILENT_NATS:g} nats, so every choice is a guess"
            )

    @property
    def silent(self) -> bool:
        """Whether readings carry almost no information about the hypotheses."""
        ratios = [np.ptp(readings, axis=1) for readings in self.log_likelihood]
        return bool(np.concatenate(ratios).mean() < SILENT_NATS)

    @property
    def baseline(self) -> float:
        """Mean log-likelihood of readings over hypotheses, averaged over true hypotheses, nats."""
        return float(np.mean([part.mean() for part in self.log_likelihood]))

    @cached_property
    def log_ratios(self) -> tuple[Array, ...]:
        """Log-likelihood ratios S2 : S1 of all readings under S1 and under S2, nats."""
        if len(self.names) != 2:
            raise InputError(
                f"log ratios need 2 hypotheses, this task has {len(self.names)}", "names"
            )
        return tuple(values[:, 1] - values[:, 0] for values in self.log_likelihood)


@dataclass(frozen=True, kw_only=True)
class Tactile(Drawn):
    """A tactile task: its hypotheses, how decoded taps become readings, and which taps."""

    taps: Path | None = None
    """Taps decoded by `bgmodel touch decode`, .parquet or .csv; by default the shipped ones, of a
    simulated sensor on gratings."""
    fold: int = 0
    """Which sixth of the held-out taps is scored, 0..5."""

    stimulus: ClassVar[str]
    """Stimulus to be tapped, a name in ``taps.STIMULI``."""
    column: ClassVar[str]
    """Column of the decoded taps that the task uses."""
    taps_per_reading: ClassVar[int]
    """Number of taps per reading."""
    range_deg: ClassVar[tuple[float, float]]
    """Range of readings, degrees."""
    circular: ClassVar[bool]
    """Whether the ends of this range are the same."""

    def __post_init__(self) -> None:
        if isinstance(self.taps, str):
            object.__setattr__(self, "taps", Path(self.taps))
        require(isinstance(self.taps, Path | None), "taps", "must be a path", self.taps)
        super().__post_init__()
        require(0 <= self.fold < FOLDS, "fold", f"must be 0..{FOLDS - 1}", self.fold)
        check_range(0, np.inf, **{self.main: getattr(self, self.main)})
        within = 2 <= self.channels <= MOST_HYPOTHESES
        must = f"must be 2 to {MOST_HYPOTHESES} in a tactile task"
        require(within, "channels", must, self.channels)

    @property
    def where(self) -> str:
        """Description of the stimulus, for use in messages."""
        raise NotImplementedError

    def pool(self, taps: pd.DataFrame) -> list[Array]:
        """Return the data used from decoded taps: one array per kind of tap, one row per tap."""
        raise NotImplementedError

    def readings(self, pool: Pool) -> list[Array]:
        """Turn a pool, or part of one, into readings: one array per hypothesis, degrees."""
        raise NotImplementedError

    def reading(self, angles_deg: Sequence[float]) -> float:
        """Combine the decoded angles of ``taps_per_reading`` taps into one reading, degrees."""
        raise NotImplementedError

    def used(self) -> dict[str, Any]:
        """Return the settings in effect, for provenance, with the decoder of a table of taps."""
        more = {} if self.taps is None else {"decoder": decoder_of(self.taps).get("sha256")}
        return super().used() | more

    def source(self, taps: pd.DataFrame | str | Path | None = None) -> Source:
        """Return all readings of the task, from its own taps by default; warn if uninformative."""
        readings = source(load_taps(self.taps if taps is None else taps), self, fold=self.fold)
        readings.warn_if_silent()
        return readings

    def _drawn(
        self, rng: np.random.Generator, prior: Sequence[float] | None, **more: Any
    ) -> Evidence:
        readings = self.source(**more)
        return readings.draw(self.trials, self.t_max, rng=rng, prior=prior, step_ms=self.step_ms)


@dataclass(frozen=True)
class Folds:
    """Readings of several folds of taps; trial k is drawn from fold k mod the number of folds.

    Many trials are drawn from few taps: a confidence interval over the trials of one fold does not
    generalise to other taps, one over ``groups`` does.
    """

    sources: Sequence[Source]

    def draw(
        self, trials: int, steps: int, *, rng: np.random.Generator, step_ms: float = STEP_MS
    ) -> Evidence:
        """Draw trials as in ``Source.draw`` from each fold in turn, one per fold at least."""
        count = len(self.sources)
        check_folds(trials, count)
        values = np.empty((trials, steps, len(self.sources[0].names)))
        truth = np.empty(trials, dtype=np.int64)
        for fold, readings in enumerate(self.sources):
            part = readings.draw(len(truth[fold::count]), steps, rng=rng, step_ms=step_ms)
            values[fold::count] = part.log_likelihood
            truth[fold::count] = np.asarray(part.truth)
        baseline = float(np.mean([readings.baseline for readings in self.sources]))
        return Evidence(values, truth, step_ms=step_ms, baseline=baseline)

    @property
    def pooled(self) -> Source:
        """The readings of all folds as one source, each with the likelihood of its fold."""
        every = zip(*(one.log_likelihood for one in self.sources), strict=True)
        return replace(self.sources[0], log_likelihood=[np.concatenate(each) for each in every])

    def groups(self, trials: int) -> npt.NDArray[np.intp]:
        """Return the fold of each trial, (trials,), for the bootstrap of ``comparison.compare``."""
        return np.arange(trials) % len(self.sources)


def held_out_taps() -> pd.DataFrame:
    """Return the decoded held-out taps included in the package.

    One row per tap: period_mm, yaw_deg, psi_deg (linear head), orientation_deg (double-angle head).
    """
    return pd.read_parquet(SHIPPED).astype("float64")


def load_taps(taps: pd.DataFrame | str | Path | None = None) -> pd.DataFrame:
    """Return decoded taps: a table, a file written by ``bgmodel touch decode``, or those included.

    Parameters
    ----------
    taps : DataFrame or path, optional
        Columns period_mm and yaw_deg, degrees, with psi_deg and orientation_deg, for gratings; or
        yaw_deg and edge_deg, degrees, for an edge. By default the table of held-out taps of a
        simulated sensor on gratings.

    Raises
    ------
    ValueError
        If it cannot be read, or if its decoder was trained on some of these taps: its accuracy on
        them would not generalise to new taps.
    """
    if taps is None:
        return held_out_taps()
    if isinstance(taps, pd.DataFrame):
        name, table = "the table", taps
    else:
        require(isinstance(taps, str | Path), "taps", "must be a table or a path", taps)
        name, table = Path(taps).name, read_table(Path(taps))
    known = 0
    if "trained_on" in table:
        known = int(table["trained_on"].map(str).isin(["True", "1", "1.0"]).sum())
    if known:
        raise InputError(
            f"the decoder of {name} was trained on {known} of its {len(table)} taps: decode "
            "taps that were not used in its training",
            "taps",
        )
    copies = int(table.select_dtypes("number").duplicated().sum())
    so = "likelihoods are scored on taps that they were fitted to"
    warn_of_copied_taps(copies, len(table), so)
    return table


def decoder_of(path: Path) -> dict[str, Any]:
    """Return the decoder's provenance from a table; empty if the table does not record it."""
    try:
        return dict(read_provenance(path)["parameters"]["decoder"])
    except (OSError, KeyError, TypeError, ValueError):
        return {}


def check_decoder(path: Path, decoder: Path, about: dict[str, Any]) -> None:
    """Refuse a table decoded by another decoder; warn if it does not record its decoder.

    ``about`` is the provenance in both of the decoder's files, .safetensors and .onnx.
    """
    recorded = decoder_of(path)
    if not recorded:
        DataWarning.warn(f"{path.name} does not record which decoder made it: it must be this one")
        return
    same = recorded.pop("sha256", "") == checksum(decoder) or recorded == json.loads(
        json.dumps(about)
    )
    if not same:
        raise InputError(
            f"{path.name} was decoded by another decoder than {decoder.name}: likelihoods differ "
            "between decoders, so decode the taps with this one",
            "taps",
        )


def source(
    taps: pd.DataFrame,
    task: Tactile,
    *,
    fold: int = 0,
    count: int = FOLDS,
) -> Source:
    """Fit likelihoods on all but one of the folds of held-out taps; return readings of that one.

    Tap k of each kind is in fold k mod ``count``.
    """
    whole("folds", count, 2)
    require(0 <= fold < count, "fold", f"must be 0..{count - 1}", fold)
    pool = task.pool(taps)
    scored = [np.arange(len(part)) % count == fold for part in pool]
    fitted = [part[~mask] for part, mask in zip(pool, scored, strict=True)]
    likelihood = fit_likelihood(fitted, task.readings, task.range_deg, circular=task.circular)
    rest = task.readings([part[mask] for part, mask in zip(pool, scored, strict=True)])
    _check_scored(rest, task)
    return Source([likelihood(x) for x in rest], task.names, likelihood, task.where)


def folds(taps: pd.DataFrame, task: Tactile, count: int = FOLDS) -> Folds:
    """Return the readings of all folds; an interval over folds needs ten or more."""
    every = range(whole("folds", count, 2))
    return Folds([source(taps, task, fold=fold, count=count) for fold in every])


def check_folds(trials: int, count: int) -> None:
    """Raise ValueError unless there are two folds or more, and a trial per fold."""
    whole("folds", count, 2)
    require(trials >= count, "trials", f"must be {count} or more, one per fold", trials)


def check_taps_per_yaw(taps: int, task: Tactile, count: int) -> None:
    """Raise ValueError if so many taps of each hypothesis' grating are too few for the folds."""
    check_fitted(taps - -(-taps // count))
    smallest = np.zeros(min(taps // count, task.taps_per_reading))
    _check_scored(task.readings([smallest] * len(task.names)), task)


def _check_scored(readings: list[Array], task: Tactile) -> None:
    """Raise ValueError unless a fold has readings of every hypothesis."""
    if not all(len(x) for x in readings):
        raise InputError(
            f"too few taps {task.where}: a fold has no reading of some hypotheses", "taps"
        )


# A 40 mm tip spans about 122 px of the 128; only the scale of displacements depends on this.
MM_PER_PX = 0.33


def decoded_edges(seed: int, recordings: Path) -> pd.DataFrame:
    """Train on ``csv_train``; return true and decoded yaw (yaw_deg, edge_deg) of ``csv_val``."""
    # Here, because tasks import this module, and those need torch and scipy.
    from bgmodel.tactile.decoder import EDGE, train
    from bgmodel.tactile.recordings import read_taps

    taps = read_taps(recordings / "csv_train", mm_per_px=MM_PER_PX)
    decoder = train(taps, seed=seed, training=EDGE)
    held = read_taps(recordings / "csv_val", mm_per_px=MM_PER_PX, rest=taps.rest_mm)
    return decoder.decode(held)[["yaw_deg", "edge_deg"]]
