"""The list of the exam: published numbers and the tasks by which circuits answer them.

The shipped list is in ``bgmodel/exam/shipped``, one file per domain; a file of the same form adds
numbers (``Exam.with_numbers``). The list has a version: scores are comparable within one.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, ClassVar, Literal

import numpy as np

from bgmodel.evidence import Evidence
from bgmodel.experiments.expected import Expected
from bgmodel.support import toml_files
from bgmodel.task import Gaussian
from circuits.checks import check_positive
from circuits.errors import require

SEED = 98_001
"""Default seed of the evidence and the noise; it tuned nothing."""
SHIPPED = Path(__file__).with_name("shipped")
TASKS = "tasks.toml"
"""The file of the tasks; the others hold numbers."""
MARKS = ("read", "abstract", "computed", "derived")
"""How a number is known: read in the source, in its abstract only, computed from the data, or
derived from theory."""
READINGS = 120
"""Largest number of readings in a trial, unless a task says otherwise."""
Window = Literal["rest", "early", "late", "response", "signal"]


@dataclass(frozen=True, kw_only=True)
class Number(Expected):
    """A published number: what is expected of a measure of the exam, and how that is known.

    Parameters
    ----------
    measure, direction, at_least, value, se, low, high, unit, source :
        As for ``Expected``: a value with its error, or a direction. The measure is a name in
        ``bgmodel.exam.measures.MEASURES``; the unit is that of the value.
    id : str
        Its name, such as "rest.stn".
    about : str
        What it is, in a few words.
    of : dict
        Arguments of the measure: tasks, nucleus, window.
    species, mark, how : str
        Whose it is; one of ``MARKS``; what is computed and how, and which sizes are assumed.
    weight : float
        Weight in the total of its domain.
    set_by : tuple of str
        Circuits whose table, or assumed sizes, were set by this number; for others it is predicted.
    domain : str
        The domain, which its file states.
    """

    id: str
    about: str
    of: dict[str, str | float]
    unit: str
    species: str
    source: str
    mark: str
    how: str
    weight: float = 1.0
    set_by: tuple[str, ...] = ()
    domain: str = ""

    def __post_init__(self) -> None:
        super().__post_init__()
        require(self.mark in MARKS, "mark", f"must be one of {', '.join(MARKS)}", self.mark)
        check_positive(owner=self.id, weight=self.weight)

    def _check_fits(self) -> None:
        """Require a direction or an error; ``Exam`` knows the measures, which are functions."""
        known = self.direction is not None or self.error(self.middle) > 0
        require(known, "value", "must have a standard error or an interval", self.value)

    def tasks(self) -> Iterator[tuple[str, str]]:
        """Yield the tasks that it needs, each with the key that names it."""
        for key, value in self.of.items():
            if key.endswith("task"):
                yield key, str(value)
            elif key == "tasks":
                yield from ((key, name.strip()) for name in str(value).split(","))

    def published(self) -> str:
        """Return the value and its error, or the direction, as text."""
        if self.direction == "none":
            return f"within ±{self.at_least:g}"
        if self.direction is not None:
            return self.direction + (f" by {self.at_least:g} or more" if self.at_least else "")
        if self.low is not None:
            return f"{self.low:g} to {self.high:g}"
        return f"{self.value:g} ± {self.se:g}"


@dataclass(frozen=True, kw_only=True)
class ExamTask(Gaussian):
    """A task of the exam: Gaussian evidence, edits, and the accuracy that sets the threshold.

    Parameters
    ----------
    id, about : str
        Its name, and what it models.
    coherence : float
        Difference between the mean evidence of the true alternative and of the others, as a share
        of that for which the likelihoods hold, as where strengths are interleaved.
    common_nats : float
        Nats that each reading adds to all channels.
    accuracy : float
        The threshold is that at which the unedited circuit has this accuracy in the reference task.
    difficulty : str
        "known", for which a constant criterion is optimal, or "interleaved", for which it falls:
        the circuit then has the motif "urgency".
    onset : bool
        Whether the evidence begins with the onset of a stimulus: the motif "onset_transient".
    edits : tuple of str
        Edits of the circuit.
    stop_share, stop_delays_ms : float, tuple of float
        Share of trials with a stop signal, and its delays, ms.
    windows : tuple of str
        Windows in which rates are recorded, in ``rate_trials`` trials of ``rate_readings``. With
        "rest" alone there is no evidence, and no decision.
    """

    id: str
    about: str
    trials: int = 1000
    t_max: int = READINGS
    coherence: float = 1.0
    common_nats: float = 0.0
    accuracy: float = 0.79
    difficulty: Literal["known", "interleaved"] = "known"
    onset: bool = False
    edits: tuple[str, ...] = ()
    stop_share: float = 0.0
    stop_delays_ms: tuple[float, ...] = ()
    windows: tuple[Window, ...] = ()
    rate_trials: int = 0
    rate_readings: int = 0

    @property
    def motifs(self) -> tuple[str, ...]:
        """Motifs of ``circuits.declaration.motifs`` that every circuit has in this task."""
        interleaved = self.difficulty == "interleaved"
        return ("urgency",) * interleaved + ("onset_transient",) * self.onset

    def _drawn(
        self, rng: np.random.Generator, prior: Sequence[float] | None, **more: Any
    ) -> Evidence:
        evidence = super()._drawn(rng, prior, **more)
        assert evidence.truth is not None
        # The true channel rises or falls, and the mean over channels stays, as with dots of another
        # coherence; common evidence is added to all channels.
        true = np.arange(self.channels) == evidence.truth[:, None]
        lead = (self.coherence - 1) * self.d_prime**2 / 2
        added = (lead * (true - 1 / self.channels) + self.common_nats)[:, None, :]
        return replace(evidence, log_likelihood=evidence.log_likelihood + added)


@dataclass(frozen=True)
class _OfDomain:
    """A file of numbers."""

    __pydantic_config__: ClassVar[dict[str, Any]] = toml_files.STRICT

    domain: str
    numbers: tuple[Number, ...]


@dataclass(frozen=True)
class _OfTasks:
    """The file of tasks."""

    __pydantic_config__: ClassVar[dict[str, Any]] = toml_files.STRICT

    version: str
    tasks: tuple[ExamTask, ...]


ORDER = (
    "rest", "blocks", "losses", "activity", "conflict", "stimulation", "lesions", "dopamine",
    "beta", "stopping", "alternatives", "times", "optimality",
)  # fmt: skip
"""Files of the shipped list, in order."""


def read_tasks() -> tuple[str, dict[str, ExamTask]]:
    """Return the version of the shipped list, and its tasks by name."""
    contents = toml_files.read(SHIPPED / TASKS, _OfTasks)
    return contents.version, {task.id: task for task in contents.tasks}


def read_numbers(*files: str | Path) -> tuple[Number, ...]:
    """Read numbers from TOML files, each of one domain; by default the shipped ones."""
    paths = files or [SHIPPED / f"{name}.toml" for name in ORDER]
    domains = [toml_files.read(path, _OfDomain) for path in paths]
    return tuple(replace(one, domain=each.domain) for each in domains for one in each.numbers)
