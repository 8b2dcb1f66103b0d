"""What the explorer shows: an experiment and a trial, as one record with its edits and its texts.

The state is an ``Experiment``, so that ``bgmodel experiment`` computes what is on the screen, and
every refusal is the sentence of the record that refuses.
"""

from __future__ import annotations

import base64
import binascii
import hashlib
import zlib
from collections.abc import Iterable
from dataclasses import dataclass, fields, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from bgmodel.bootstrap import check_trials
from bgmodel.experiments.experiment import Experiment
from bgmodel.experiments.record import Changes
from bgmodel.names import CircuitName, EngineName
from bgmodel.stopping.task import StopTask
from bgmodel.support import toml_files
from bgmodel.tables.given import EvidenceTable
from bgmodel.task import Gaussian, Task
from circuits import DEFAULT
from circuits.anatomy import CIRCUITS
from circuits.declaration.edits import Edits
from circuits.declaration.table_files import digest
from circuits.errors import InputError, require

if TYPE_CHECKING:
    from circuits.circuit import Circuit

NAME = "Explored"
NOTE = "Set up in the explorer; state here why the manipulation models the published one."
TRIALS, READINGS, POSTERIOR = 1000, 120, 0.74
"""Settings of a new state, those of most included experiments, with fewer trials."""
MOST_TRIALS = 4000
"""Largest number of trials in the explorer; an included experiment with more begins with 1 000."""
OF_RUN = ("posterior", "threshold", "gain", "seed", "engine", "circuit")
OF_STOP = tuple(field.name for field in fields(StopTask))
MOST_TEXT = 100_000
"""Largest text that a link may contain, characters: more is no experiment."""
QUERY = "state"
"""Name of the part of a link that contains the state."""


@dataclass(frozen=True)
class State:
    """A control, a manipulation (the edited circuit), their task, and one trial."""

    experiment: Experiment
    """The experiment whose behaviour is shown."""
    trial: int = 0
    """The trial that is shown in spikes, from 0."""

    def __post_init__(self) -> None:
        trials = self.experiment.trials
        require(trials <= MOST_TRIALS, "trials", f"must be at most {MOST_TRIALS} here", trials)
        require(0 <= self.trial < trials, "trial", f"must be within 0..{trials - 1}", self.trial)
        require(
            not any(self.experiment.learnings),
            "learning",
            "must be left out in the explorer: `bgmodel experiment` runs it",
            "[learning]",
        )

    # ---- edits

    @property
    def edits(self) -> Edits:
        """The edits of the edited circuit, in addition to those of the control."""
        return self.experiment.manipulation.edits

    def edited(self, *lines: str) -> State:
        """Return the state with further edits, which replace those of the same target."""
        return self.with_edits(self.edits.replacing(lines))

    def without(self, *lines: str) -> State:
        """Return the state without some of its edits."""
        return self.with_edits(line for line in self.edits if line not in lines)

    def with_edits(self, lines: Iterable[str]) -> State:
        """Return the state with other edits of the edited circuit; predictions are removed.

        Predictions and published effects are about the manipulation that they were written for.
        """
        edits = Edits(lines)
        if edits == self.edits:
            return self
        changes = replace(self.experiment.manipulation, edits=edits)
        return self._with(manipulation=changes, **self._unnamed())

    def as_control(self) -> State:
        """Return the state whose control is the edited circuit, to which further edits add."""
        edits = self.edits
        return self._with(control=replace(self.experiment.control, edits=edits), **self._unnamed())

    def with_setting(self, name: str, value: Any) -> State:
        """Return the state with one setting of the task, the stop signal or the run changed.

        None leaves a setting out; ``evidence`` is the file of a table, and ``stop.NAME`` a field of
        ``StopTask``.
        """
        if name == "trial":
            return replace(self, trial=value)
        if name == "stop":
            return self._with(stop=None if value is None else StopTask(), **self._unnamed())
        if name.startswith("stop."):
            stop = replace(
                self.experiment.stop or StopTask(), **{name.removeprefix("stop."): value}
            )
            return self._with(stop=stop, **self._unnamed())
        if name == "evidence":
            return self._with(task=self._task_of(value), **self._unnamed())
        task = self.experiment.task
        if name in (own := task.settings()):
            task = task.changed(**{name: value})
            if name == "trials":
                check_trials(value)
            return self._with(task=task, **self._unnamed())
        require(name in OF_RUN, "name", f"must be one of {', '.join((*own, *OF_RUN))}", name)
        if value is not None and name in ("circuit", "engine"):
            value = (CircuitName if name == "circuit" else EngineName)(value)
        other = {"posterior": "threshold", "threshold": "posterior"}.get(name)
        changes = {name: value} | ({other: None} if other and value is not None else {})
        if name in ("posterior", "threshold"):
            # A posterior that only the manipulation has would hide the new one.
            plain = replace(self.experiment.manipulation, posterior=None)
            changes |= {"manipulation": plain}
        return self._with(**changes, **self._unnamed())

    def _with(self, **changes: Any) -> State:
        experiment = replace(self.experiment, **changes)
        return State(experiment, min(self.trial, experiment.trials - 1))

    def _task_of(self, table: str | Path | None) -> Task:
        """Return the task of an evidence table, or the usual one without a table."""
        step_ms = self.experiment.task.step_ms
        if table is None:
            return Gaussian(trials=TRIALS, t_max=READINGS, step_ms=step_ms)
        return EvidenceTable(Path(table), step_ms=step_ms)

    def _unnamed(self) -> dict[str, Any]:
        """Return the fields of an experiment that no longer describe it."""
        if self.experiment.name == NAME and not self.experiment.predictions:
            return {}
        return {
            "name": NAME,
            "note": NOTE,
            "published": "",
            "source": "",
            "predictions": (),
            "effects": (),
        }

    # ---- what it is about

    @cached_property
    def control(self) -> Circuit:
        """The circuit of the control."""
        return self.experiment.conditions[0].edited

    @cached_property
    def circuit(self) -> Circuit:
        """The edited circuit."""
        return self.experiment.conditions[1].edited

    @cached_property
    def digest(self) -> str:
        """SHA-256 of the edited circuit."""
        return digest(self.circuit)

    @cached_property
    def key(self) -> str:
        """SHA-256 of all of the state, the circuits' numbers included."""
        own = f"{self.trial} {digest(self.control)} {self.digest} {self.experiment.to_toml()}"
        return hashlib.sha256(own.encode()).hexdigest()

    @cached_property
    def alike(self) -> bool:
        """Whether both conditions are the same."""
        control, manipulation = self.experiment.conditions
        same = control.threshold_nats == manipulation.threshold_nats
        return same and self.control == self.circuit

    def check(self) -> None:
        """Raise ValueError for what can be refused before a run, as ``bgmodel experiment`` does."""
        if self.alike:
            control, manipulation = self.experiment.conditions
            manipulation.check(control)
        else:
            self.experiment.check_differs()

    # ---- as text

    def link(self, address: str = "") -> str:
        """Return a link to this state: an address, and the file of the experiment, compressed."""
        packed = zlib.compress(self.experiment.to_toml().encode(), 9)
        code = base64.urlsafe_b64encode(packed).decode().rstrip("=")
        return f"{address}?{QUERY}={code}" + (f"&trial={self.trial}" if self.trial else "")

    @classmethod
    def from_link(cls, link: str) -> State:
        """Return the state of a link, or of the part of it that follows the question mark."""
        from urllib.parse import parse_qs

        given = parse_qs(link.partition("?")[2])
        code, trial = given.get(QUERY, [""])[0], given.get("trial", ["0"])[0]
        unpack = zlib.decompressobj()
        try:
            packed = base64.urlsafe_b64decode(code + "=" * (-len(code) % 4))
            text = unpack.decompress(packed, MOST_TEXT).decode()
            if not unpack.eof:
                raise ValueError("not whole")
        except (ValueError, binascii.Error, zlib.error):
            raise InputError("the link has no whole state: copy it again", "link") from None
        experiment = Experiment.from_text(text, "the link")
        return cls(experiment, int(trial) if trial.isdecimal() else 0)


def opened(name: str | Path) -> State:
    """Return the state of a circuit or an experiment, by name or file, or of a link."""
    text = str(name).strip()
    if f"?{QUERY}=" in text:
        return State.from_link(text)
    if text.endswith(".toml") and not toml_files.gives(text, "manipulation"):
        return of_circuit(text)
    if text in CIRCUITS or not text:
        return of_circuit(text or DEFAULT)
    try:
        experiment = Experiment.from_toml(text)
    except InputError as error:
        if text.endswith(".toml"):
            raise
        known = ", ".join(CIRCUITS)
        raise InputError(f"{error}, or one of the circuits {known}", "file", text) from None
    return State(_few(experiment))


def _few(experiment: Experiment) -> Experiment:
    """Return an experiment with few enough trials for an interactive view."""
    task = experiment.task
    if isinstance(task, EvidenceTable) or task.trials <= MOST_TRIALS:
        return experiment
    return replace(experiment, task=task.changed(trials=TRIALS))


def of_circuit(name: str) -> State:
    """Return a state of a circuit without edits, at the usual task."""
    from circuits.anatomy import load_circuit

    path = name.endswith(".toml")
    channels = load_circuit(name).channels if path else 2
    return State(
        Experiment(
            name=NAME,
            note=NOTE,
            circuit=CircuitName(name),
            task=Gaussian(channels, trials=TRIALS, t_max=READINGS),
            posterior=POSTERIOR,
            manipulation=Changes(),
        )
    )
