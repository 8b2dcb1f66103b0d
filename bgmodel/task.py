"""Tasks: what is asked in a trial, and how its evidence is drawn."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import Field, dataclass, fields, replace
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Self

import numpy as np

from bgmodel.evidence import Evidence, whole_steps
from bgmodel.simulated_evidence import expecting, gaussian_evidence
from bgmodel.support import toml_files
from bgmodel.support.processes import check_evidence_memory
from bgmodel.support.seeds import generator, stream
from circuits.checks import check_positive, check_range, check_types
from circuits.errors import InputError, require

KINDS = {
    "gaussian": "bgmodel.task.Gaussian",
    "same-different": "bgmodel.tactile.task.SameDifferent",
    "orientation": "bgmodel.tactile.task.Orientation",
    "edge-turn": "bgmodel.tactile.task.EdgeTurn",
    "edge-direction": "bgmodel.tactile.task.EdgeDirection",
    "table": "bgmodel.trials.task_trials.EvidenceTable",
}
"""Classes of tasks by the name that they have in files and commands."""


def kind_of(name: str) -> type[Task]:
    """Return the class of a task by its name; ValueError for an unknown one."""
    require(name in KINDS, "task", f"must be one of {', '.join(KINDS)}", name)
    module, _, kind = KINDS[name].rpartition(".")
    task_class: type[Task] = getattr(import_module(module), kind)
    return task_class


def settings_of_tasks() -> dict[str, Field[Any]]:
    """Return the settings of all tasks by name, those of the first kind that has it."""
    every = (each for name in KINDS for each in fields(kind_of(name)))
    by_name: dict[str, Field[Any]] = {}
    for each in sorted(every, key=lambda each: bool(each.kw_only)):
        by_name.setdefault(each.name, each)
    return by_name


@dataclass(frozen=True)
class Task:
    """Base of all tasks.

    Raises
    ------
    ValueError
        For a number out of its range.
    """

    __pydantic_config__: ClassVar[dict[str, Any]] = toml_files.STRICT
    name: ClassVar[str]
    """Name in files and commands."""
    if TYPE_CHECKING:  # fields of some tasks, and read from the file of another

        @property
        def channels(self) -> int:
            """Number of alternatives."""

        @property
        def trials(self) -> int:
            """Number of trials."""

        @property
        def t_max(self) -> int:
            """Largest number of readings in a trial."""

        @property
        def step_ms(self) -> float:
            """Time between readings, ms."""

    @property
    def expectancy_nats(self) -> float:
        """Largest expectancy at the end of a foreperiod, nats."""
        return 0.0

    @property
    def expectancy_ms(self) -> float:
        """Duration of that foreperiod, ms."""
        return 0.0

    def __post_init__(self) -> None:
        check_types(self, type(self).__name__)
        check_positive(step_ms=self.step_ms)
        for each in fields(self):  # 2 and 2.0 are one setting, but other names of random numbers
            if kind := {"float": float, "int": int}.get(str(each.type)):
                object.__setattr__(self, each.name, kind(getattr(self, each.name)))

    @property
    def file(self) -> Path | None:
        """Path of an evidence table; None for a task whose trials are drawn."""
        return None

    @property
    def text(self) -> str:
        """The task in a few words."""
        return self.name

    def settings(self) -> dict[str, Any]:
        """Return the name and all settings, as in a file."""
        ordered = sorted(fields(self), key=lambda each: bool(each.kw_only))
        values = {each.name: getattr(self, each.name) for each in ordered}
        return {"name": self.name} | {
            key: str(value) if isinstance(value, Path) else value
            for key, value in values.items()
            if value is not None
        }

    def used(self) -> dict[str, Any]:
        """Return the settings in effect, for provenance."""
        values = {each.name: getattr(self, each.name) for each in fields(self)}
        return {"name": self.name} | {k: v for k, v in values.items() if v is not None}

    def seen_from(self, folder: Path) -> Self:
        """Return the task with relative paths resolved against the folder of its file."""
        paths = {name: value for name, value in vars(self).items() if isinstance(value, Path)}
        return replace(self, **{name: folder / value for name, value in paths.items()})

    def changed(self, **changes: Any) -> Self:
        """Return the task with some settings changed; ValueError for one that it does not have."""
        known = [each.name for each in fields(self)]
        for name in changes:
            must = f"must be a setting of the task {self.name}: {', '.join(known)}"
            require(name in known, name, must, name)
        return replace(self, **changes)

    @staticmethod
    def from_settings(settings: dict[str, Any]) -> Task:
        """Return the task of settings as in a file; Gaussian evidence if they do not name one.

        Settings with ``evidence``, the path of a table, are those of an ``EvidenceTable``.

        Raises
        ------
        ValueError
            For an unknown name, or a setting that the task does not have.
        """
        if isinstance(settings, Task):
            return settings
        require(isinstance(settings, dict), "task", "must be a table of settings", settings)
        unnamed = {key: value for key, value in settings.items() if key != "name"}
        name = settings.get("name", "table" if "evidence" in unnamed else Gaussian.name)
        return toml_files.decoded(unnamed, kind_of(name), "", "task")

    @classmethod
    def __get_pydantic_core_schema__(cls, source: Any, handler: Any) -> Any:
        """How a field of this type is read from a file: the name chooses the class."""
        if cls is not Task:
            return handler(source)
        from pydantic_core import core_schema

        return core_schema.no_info_plain_validator_function(Task.from_settings)


@dataclass(frozen=True, kw_only=True)
class Drawn(Task):
    """A task whose trials are drawn with a seed."""

    trials: int = 100
    """Number of trials to draw."""
    t_max: int = 40
    """Largest number of readings in a trial."""
    step_ms: float = 50.0
    """Time between readings, ms."""
    expectancy_nats: float = 0.0
    """Largest expectancy at the end of a foreperiod, common to all channels, nats of evidence. It
    rises from 0 to a value drawn for each trial from a uniform distribution up to this."""
    expectancy_ms: float = 0.0
    """Duration of that foreperiod, ms."""

    main: ClassVar[str]
    """The setting that says how difficult it is."""

    def __post_init__(self) -> None:
        super().__post_init__()
        for name in ("trials", "t_max"):
            require(getattr(self, name) >= 1, name, "must be at least 1", getattr(self, name))
        require(self.channels >= 2, "channels", "must be at least 2", self.channels)
        check_range(0, np.inf, expectancy_nats=self.expectancy_nats)
        if self.expectancy_nats:
            whole_steps(self.expectancy_ms, self.step_ms)
        elif self.expectancy_ms:
            raise InputError(
                "expectancy_ms is for a task with expectancy_nats > 0, got 0 nats", "expectancy_ms"
            )

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the alternatives."""
        return tuple(str(k) for k in range(self.channels))

    @property
    def text(self) -> str:
        """The task, its number of alternatives and its difficulty."""
        value = getattr(self, self.main)
        return f"{self.name}, {self.channels} alternatives, {self.main} {value:g}"

    def used(self) -> dict[str, Any]:
        """Return the settings in effect, for provenance."""
        idle = () if self.expectancy_nats else ("expectancy_nats", "expectancy_ms")
        return {key: value for key, value in super().used().items() if key not in idle}

    def evidence(
        self,
        trials: int | None = None,
        *,
        seed: np.random.Generator | int,
        prior: Sequence[float] | None = None,
        **more: Any,
    ) -> Evidence:
        """Draw trials and return their evidence, with the truth of each.

        Parameters
        ----------
        trials : int, optional
            Number of trials; by default that of the task.
        seed : int or numpy.random.Generator
            The source of all random numbers.
        prior : sequence of float (channels,), optional
            Prior probabilities assumed by the integrator; equal by default.
        **more
            Of a tactile task: ``taps``, a table of decoded taps or its file, in place of the
            task's own.

        Raises
        ------
        ValueError
            For a number out of its range, or taps that the task cannot use.
        """
        asked = self if trials is None else replace(self, trials=trials)
        rng = generator(seed, "seed")
        ahead = stream(seed, "expectancy") if isinstance(seed, int) else rng
        return asked.drawn_with(rng, ahead, prior, **more)

    def drawn_with(
        self,
        rng: np.random.Generator,
        ahead: np.random.Generator,
        prior: Sequence[float] | None = None,
        **more: Any,
    ) -> Evidence:
        """Return evidence from a generator, and expectancy from another one.

        The evidence is then the same with and without expectancy.
        """
        check_evidence_memory(self.trials, self.t_max, self.channels)
        evidence = self._drawn(rng, prior, **more)
        if not self.expectancy_nats:
            return evidence
        return expecting(evidence, self.expectancy_nats, self.expectancy_ms, rng=ahead)

    def _drawn(
        self, rng: np.random.Generator, prior: Sequence[float] | None, **more: Any
    ) -> Evidence:
        """Return the evidence from its onset."""
        raise NotImplementedError


@dataclass(frozen=True)
class Gaussian(Drawn):
    """Gaussian evidence: in each reading the true channel has a higher mean than the others."""

    channels: int = 2
    """Number of alternatives."""
    d_prime: float = 0.5
    """Discriminability of two hypotheses by one reading: separation in standard deviations of their
    difference."""
    conflict: float = 0.0
    """Mean of one competitor relative to that of the truth: 0 is that of the other channels, 1
    that of the truth."""

    name: ClassVar[str] = "gaussian"
    main: ClassVar[str] = "d_prime"

    def __post_init__(self) -> None:
        super().__post_init__()
        check_positive(d_prime=self.d_prime)
        require(0 <= self.conflict < 1, "conflict", "must be within 0..1, below 1", self.conflict)

    def _drawn(
        self, rng: np.random.Generator, prior: Sequence[float] | None, **more: Any
    ) -> Evidence:
        for name in more:
            raise InputError(f"{name} is for a tactile task, not for Gaussian evidence", name)
        drawn = gaussian_evidence(
            self.trials, d_prime=self.d_prime, channels=self.channels, t_max=self.t_max,
            step_ms=self.step_ms, conflict=self.conflict, seed=rng,
        )  # fmt: skip
        return drawn if prior is None else replace(drawn, prior=prior)  # type: ignore[arg-type]
