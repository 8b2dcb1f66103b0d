"""The list of the exam: published numbers and the tasks by which circuits answer them.

The shipped list is in ``bgmodel/exam/shipped``, one file per domain; a file of the same form adds
numbers (``Exam.with_numbers``). The list has a version: scores are comparable within one.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from importlib.resources import files as resources
from pathlib import Path
from typing import Any, ClassVar, Literal

from bgmodel.experiments.expected import Expected
from bgmodel.support import toml_files
from circuits.checks import check_positive
from circuits.errors import require

SEED = 98_001
"""Default seed of the evidence and the noise; it tuned nothing."""
SHIPPED = resources("bgmodel.exam") / "shipped"
TASKS = "tasks.toml"
"""The file of the tasks; the others hold numbers."""
MARKS = ("read", "abstract", "computed", "derived")
"""How a number is known: read in the source, in its abstract only, computed from the data, or
derived from theory."""
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
class Task:
    """A task of the exam: evidence, edits, and the accuracy that sets the threshold.

    Parameters
    ----------
    name, about : str
        Its name, and what it models.
    channels, d_prime, step_ms, readings, conflict, expectancy_nats, expectancy_ms :
        As for ``bgmodel.Gaussian``; ``readings`` is the largest number in a trial.
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
    trials : int
        Trials of choices and times.
    stop_share, stop_delays_ms : float, tuple of float
        Share of trials with a stop signal, and its delays, ms.
    windows : tuple of str
        Windows in which rates are recorded, in ``rate_trials`` trials of ``rate_readings``.
    """

    __pydantic_config__: ClassVar[dict[str, Any]] = toml_files.STRICT

    name: str
    about: str
    channels: int = 2
    d_prime: float = 0.5
    step_ms: float = 50.0
    readings: int = 120
    conflict: float = 0.0
    coherence: float = 1.0
    common_nats: float = 0.0
    expectancy_nats: float = 0.0
    expectancy_ms: float = 0.0
    accuracy: float = 0.79
    difficulty: Literal["known", "interleaved"] = "known"
    onset: bool = False
    edits: tuple[str, ...] = ()
    trials: int = 1000
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
    tasks: tuple[Task, ...]


@dataclass(frozen=True)
class NumberList:
    """Numbers and tasks, with the version and the hash of the list."""

    version: str
    numbers: tuple[Number, ...]
    tasks: dict[str, Task] = field(repr=False)

    def __post_init__(self) -> None:
        names = [one.id for one in self.numbers]
        twice = sorted({name for name in names if names.count(name) > 1})
        require(not twice, "id", "must differ from those of all other numbers", twice)
        for one in self.numbers:
            for key, name in self.tasks_of(one):
                known = ", ".join(self.tasks)
                require(name in self.tasks, key, f"must be one of {known}", name, owner=one.id)

    @staticmethod
    def tasks_of(number: Number) -> Iterator[tuple[str, str]]:
        """Yield the tasks that a number needs, each with the key that names it."""
        for key, value in number.of.items():
            if key.endswith("task"):
                yield key, str(value)
            elif key == "tasks":
                yield from ((key, name.strip()) for name in str(value).split(","))

    @property
    def sha256(self) -> str:
        """Hash of all numbers and tasks."""
        text = repr((self.version, self.numbers, sorted(self.tasks.items())))
        return hashlib.sha256(text.encode()).hexdigest()

    @property
    def domains(self) -> list[str]:
        """Domains, in the order of the list."""
        return list(dict.fromkeys(one.domain for one in self.numbers))


ORDER = (
    "rest", "blocks", "losses", "activity", "conflict", "stimulation", "lesions", "dopamine",
    "beta", "stopping", "alternatives", "times", "optimality",
)  # fmt: skip
"""Files of the shipped list, in order."""


def shipped_list() -> NumberList:
    """Return the shipped list."""
    tasks = toml_files.read(Path(str(SHIPPED / TASKS)), _OfTasks)
    numbers = [one for name in ORDER for one in read_numbers(Path(str(SHIPPED / f"{name}.toml")))]
    return NumberList(tasks.version, tuple(numbers), {task.name: task for task in tasks.tasks})


def read_numbers(path: str | Path) -> tuple[Number, ...]:
    """Read the numbers of one domain from a TOML file."""
    contents = toml_files.read(path, _OfDomain)
    return tuple(replace(one, domain=contents.domain) for one in contents.numbers)
