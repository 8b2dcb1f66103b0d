"""The task of a circuit: options shared by commands and experiments."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, TypeVar, get_args

import numpy as np

from bgmodel.evidence import whole_steps
from bgmodel.simulated_evidence import expecting, gaussian_evidence
from bgmodel.support.memory import check_evidence_memory
from bgmodel.support.seeds import stream
from bgmodel.tables.trials import Trials
from circuits.checks import check_positive, check_range, check_types
from circuits.errors import InputError, require

if TYPE_CHECKING:
    from bgmodel.tactile.likelihood import Density
    from bgmodel.tactile.source import Source

Asked = TypeVar("Asked", bound=Any)


Task = Literal["gaussian", "same-different", "orientation", "edge-turn", "edge-direction"]
OF_TASK = {
    "gaussian": ("channels", "d_prime", "conflict"),
    "same-different": ("period_mm", "fold", "taps"),
    "orientation": ("channels", "period_mm", "fold", "taps"),
    "edge-turn": ("channels", "step_deg", "fold", "taps"),
    "edge-direction": ("channels", "step_deg", "fold", "taps"),
}
"""Options that a task uses, in addition to those of every task."""


@dataclass(frozen=True)
class Stimuli:
    """The task: Gaussian evidence, tactile evidence, or your own evidence table."""

    evidence: Path | None = None
    """A table of log-likelihoods, as for `bgmodel decide`, instead of a task."""
    task: Task = "gaussian"
    """Gaussian evidence, or a tactile task: are two gratings the same or different, which of N
    orientations has a grating, by how many steps was an edge turned, which of N directions does it
    have."""
    channels: int = 2
    """Alternatives; 2..8 for a tactile task."""
    d_prime: float = 0.5
    """Discriminability of Gaussian evidence per reading: separation of two hypotheses, in standard
    deviations of their difference."""
    conflict: float = 0.0
    """Mean of one competitor relative to that of the truth in Gaussian evidence: 0 is that of the
    other channels, 1 that of the truth."""
    period_mm: float = 2.0
    """Period of the tactile grating, mm."""
    step_deg: float = 5.0
    """Degrees between the alternatives of a task with edges."""
    taps: Path | None = None
    """Taps decoded by `bgmodel decode`, .parquet or .csv; by default the shipped ones, of a
    simulated sensor on gratings."""
    fold: int = 0
    """Which sixth of the held-out taps is scored, 0..5."""
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

    def __post_init__(self) -> None:
        for name in ("evidence", "taps"):
            if isinstance(getattr(self, name), str):
                object.__setattr__(self, name, Path(getattr(self, name)))

    def check(self) -> None:
        """Raise ValueError for a number out of range."""
        check_types(self, type(self).__name__)
        for name in ("evidence", "taps"):
            path = getattr(self, name)
            require(isinstance(path, Path | None), name, "must be a path", path)
        require(
            str(self.task) in get_args(Task),
            "task",
            f"must be one of {', '.join(get_args(Task))}",
            self.task,
        )
        for name in ("trials", "t_max"):
            require(getattr(self, name) >= 1, name, "must be at least 1", getattr(self, name))
        require(self.channels >= 2, "channels", "must be at least 2", self.channels)
        check_positive(d_prime=self.d_prime, step_ms=self.step_ms)
        self._check_expectancy()
        require(0 <= self.conflict < 1, "conflict", "must be within 0..1, below 1", self.conflict)
        require(0 < self.step_deg <= 180, "step_deg", "must be within 0..180", self.step_deg)
        if self.task == "same-different" and self.channels != 2:
            raise InputError(
                f"same-different has 2 alternatives, got channels {self.channels}", "channels"
            )

    def check_idle(self, default: Stimuli | None = None) -> None:
        """Raise ValueError for a setting that this task does not use.

        Parameters
        ----------
        default : Stimuli, optional
            The default values.
        """
        default = default or Stimuli(trials=self.trials, t_max=self.t_max)
        if self.evidence is not None:
            self._check_alone(default)
        self._check_task(default)

    def _check_expectancy(self) -> None:
        check_range(0, np.inf, expectancy_nats=self.expectancy_nats)
        if self.expectancy_nats:
            whole_steps(self.expectancy_ms, self.step_ms)
        elif self.expectancy_ms:
            raise InputError(
                "expectancy_ms is for a task with expectancy_nats > 0, got 0 nats", "expectancy_ms"
            )

    def _check_task(self, default: Stimuli) -> None:
        """Refuse options of tactile tasks with Gaussian evidence, and the reverse."""
        own = ("channels", *OF_TASK[self.task])
        every = dict.fromkeys(name for names in OF_TASK.values() for name in names)
        for name in every:
            if name not in own and getattr(self, name) != getattr(default, name):
                users = ", ".join(task for task, names in OF_TASK.items() if name in names)
                raise InputError(f"{name} is for {users}: task {self.task} does not use it", name)

    def _check_alone(self, default: Stimuli) -> None:
        """Refuse options of randomly drawn evidence with an evidence table."""
        own = replace(default, evidence=self.evidence, step_ms=self.step_ms)
        for option in fields(self):
            if getattr(self, option.name) != getattr(own, option.name):
                raise InputError(
                    f"{option.name} is for evidence that is drawn and does not apply to "
                    f"{str(self.evidence)!r}",
                    option.name,
                )

    def used(self) -> dict[str, Any]:
        """Return the options in effect, by name, for provenance."""
        names = [name for name in OF_TASK[self.task] if name != "taps" or self.taps is not None]
        names = ["task", *names, "trials", "t_max", "step_ms"]
        names = ["evidence", "step_ms"] if self.evidence is not None else names
        if self.expectancy_nats:
            names += ["expectancy_nats", "expectancy_ms"]
        found = {name: getattr(self, name) for name in names}
        if self.taps is not None and "taps" in names:
            from bgmodel.tactile.source import decoder_of

            found["decoder"] = decoder_of(self.taps).get("sha256")
        return found

    def draw(
        self,
        seed: int,
        name: str,
        *,
        prior: Sequence[float] | None = None,
        density: Density | None = None,
    ) -> Trials:
        """Return the evidence, the names of its hypotheses, and the other columns of a table.

        Parameters
        ----------
        seed, name : int and str
            Seed and name of the random-number stream.
        prior : sequence of float (hypotheses,), optional
            Prior probabilities assumed by the integrator; equal if omitted.
        density : Density, optional
            How likelihoods of decoded taps are estimated.
        """
        self.check()
        self._check_task(replace(self, taps=None))
        if self.evidence is not None:
            from bgmodel.tables.evidence import read_evidence_table

            return read_evidence_table(self.evidence, prior=prior, step_ms=self.step_ms)
        check_evidence_memory(self.trials, self.t_max, self.channels)
        drawn = self._drawn(stream(seed, name), prior, density)
        if not self.expectancy_nats:
            return drawn
        # A separate stream: the evidence is the same with and without expectancy.
        rng = stream(seed, name, "expectancy")
        ahead = expecting(drawn.evidence, self.expectancy_nats, self.expectancy_ms, rng=rng)
        return replace(drawn, evidence=ahead)

    def _drawn(
        self, rng: np.random.Generator, prior: Sequence[float] | None, density: Density | None
    ) -> Trials:
        """Return the evidence of a task from its onset."""
        if self.task == "gaussian":
            drawn = gaussian_evidence(
                self.trials, d_prime=self.d_prime, channels=self.channels, t_max=self.t_max,
                step_ms=self.step_ms, conflict=self.conflict, seed=rng,
            )  # fmt: skip
            if prior is not None:
                drawn = replace(drawn, prior=np.asarray(prior, dtype=np.float64))
            return Trials(drawn, [str(i) for i in range(self.channels)])
        readings = self.readings(density)
        tapped = readings.draw(self.trials, self.t_max, rng=rng, prior=prior, step_ms=self.step_ms)
        return Trials(tapped, list(readings.names))

    def readings(self, density: Density | None = None) -> Source:
        """Return all readings of a tactile task; warn if they are uninformative."""
        from bgmodel.tactile.source import readings_of

        return readings_of(
            self.task, self.channels, period_mm=self.period_mm, step_deg=self.step_deg,
            taps=self.taps, fold=self.fold, density=density,
        )  # fmt: skip


def circuit_seen_from(folder: Path, name: str) -> str:
    """Return a circuit's name unchanged, or its path relative to the folder of the naming file.

    Parameters
    ----------
    folder : Path
        The folder of the file that names the circuit.
    name : str
        Name of a table, or the path of a .toml file.
    """
    from circuits.declaration.table_files import is_path

    return str(folder / name) if is_path(name) else name


def seen_from(folder: Path, asked: Asked) -> Asked:
    """Return the contents of a file, with relative paths resolved against its folder.

    Parameters
    ----------
    folder : Path
        The folder of the file.
    asked : dataclass
        With the fields ``circuit``, a name or a path, and ``task``, a ``Stimuli``.

    Returns
    -------
    dataclass
        Of the same type; absolute paths are unchanged.
    """
    task = asked.task
    for name in ("evidence", "taps"):
        if getattr(task, name) is not None:
            task = replace(task, **{name: folder / getattr(task, name)})
    return replace(asked, circuit=circuit_seen_from(folder, asked.circuit), task=task)
