"""The state of the explorer, an experiment and the number of a trial, and its history.

The state is an ``Experiment``, so that ``bgmodel experiment`` computes the numbers on the screen
and errors are those of its records.
"""

from __future__ import annotations

import base64
import binascii
import hashlib
import zlib
from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any
from urllib.parse import parse_qs

from bgmodel.bootstrap import check_trials
from bgmodel.experiments.experiment import Experiment
from bgmodel.experiments.record import Changes
from bgmodel.names import CircuitName, EngineName
from bgmodel.stopping.task import StopTask
from bgmodel.support import toml_files
from bgmodel.task import Gaussian
from bgmodel.trials.task_trials import EvidenceTable
from circuits import DEFAULT
from circuits.anatomy import CIRCUITS, load_circuit
from circuits.circuit import Circuit
from circuits.declaration.edits import Edits
from circuits.declaration.table_writer import digest
from circuits.errors import InputError, require

NAME = "Explored"
NOTE = "Made in the explorer; state here why the manipulation models the published one."
TRIALS, READINGS, POSTERIOR = 1000, 120, 0.74
"""Settings of a new state, those of most included experiments, with fewer trials."""
MOST_TRIALS = 4000
"""Largest number of trials in the explorer; included experiments with more start with 1 000."""
OF_RUN = ("posterior", "threshold", "gain", "seed", "engine", "circuit")
MOST_TEXT = 100_000
"""Largest text that a link may contain, characters; experiments are much shorter."""
QUERY = "state"
"""Name of the part of a link that contains the state."""
LONGEST = 200
"""Largest number of states that can be undone."""


@dataclass(frozen=True)
class ExplorerState:
    """A control, a manipulation (the edited circuit), their task, and one trial."""

    experiment: Experiment
    """The experiment whose behaviour is shown."""
    trial: int = 0
    """The trial that is shown in spikes, from 0."""

    def __post_init__(self) -> None:
        trials = self.experiment.trials
        require(trials <= MOST_TRIALS, "trials", f"must be at most {MOST_TRIALS} here", trials)
        require(0 <= self.trial < trials, "trial", f"must be within 0..{trials - 1}", self.trial)

    # ---- edits

    @property
    def edits(self) -> Edits:
        """The edits of the edited circuit, in addition to those of the control."""
        return self.experiment.manipulation.edits

    def edited(self, *lines: str) -> ExplorerState:
        """Return the state with further edits, which replace those of the same target."""
        return self.with_edits(self.edits.replacing(lines))

    def without(self, *lines: str) -> ExplorerState:
        """Return the state without some of its edits."""
        return self.with_edits(line for line in self.edits if line not in lines)

    def with_edits(self, lines: Iterable[str]) -> ExplorerState:
        """Return the state with other edits of the edited circuit."""
        edits = Edits(lines)
        if edits == self.edits:
            return self
        return self._with(manipulation=replace(self.experiment.manipulation, edits=edits))

    def as_control(self) -> ExplorerState:
        """Return the state whose control is the edited circuit, to which further edits add."""
        return self._with(control=replace(self.experiment.control, edits=self.edits))

    def setting(self, name: str) -> Any:
        """Return a setting by the name that ``with_setting`` takes; None if it has no value."""
        if name == "trial":
            return self.trial
        if name == "evidence":
            return str(self.experiment.task.file or "")
        if name == "stop":
            return self.experiment.stop is not None
        if name.startswith("stop."):
            return getattr(self.experiment.stop, name.removeprefix("stop."), None)
        record = self.experiment if name in OF_RUN else self.experiment.task
        return getattr(record, name, None)

    def with_setting(self, name: str, value: Any) -> ExplorerState:
        """Return the state with one setting of the task, the stop signal or the run changed.

        None leaves a setting out. ``evidence`` is the file of a table, and ``stop.NAME`` a field of
        ``StopTask``.
        """
        task, stop = self.experiment.task, self.experiment.stop
        if name == "trial":
            return replace(self, trial=value)
        if name == "stop":
            return self._with(stop=StopTask() if value else None)
        if name.startswith("stop."):
            return self._with(
                stop=replace(stop or StopTask(), **{name.removeprefix("stop."): value})
            )
        if name == "evidence":
            step_ms = task.step_ms
            usual = Gaussian(trials=TRIALS, t_max=READINGS, step_ms=step_ms)
            return self._with(task=EvidenceTable(Path(value), step_ms=step_ms) if value else usual)
        if name in (known := task.settings()):
            task = task.changed(**{name: value})
            if name == "trials":
                check_trials(value)
            return self._with(task=task)
        require(name in OF_RUN, "name", f"must be one of {', '.join((*known, *OF_RUN))}", name)
        if value is not None and name in ("circuit", "engine"):
            value = (CircuitName if name == "circuit" else EngineName)(value)
        changes = {name: value}
        if name in ("posterior", "threshold"):
            if value is not None:
                changes["threshold" if name == "posterior" else "posterior"] = None
            # A posterior that only the manipulation has would hide the new one.
            changes["manipulation"] = replace(self.experiment.manipulation, posterior=None)
        return self._with(**changes)

    def _with(self, **changes: Any) -> ExplorerState:
        """Return the state with other fields of its experiment, without texts about the old one.

        Predictions and published effects refer to the manipulation that they were written for.
        """
        if self.experiment.name != NAME or self.experiment.predictions:
            changes |= {"name": NAME, "note": NOTE, "published": "", "source": ""}
            changes |= {"predictions": (), "effects": ()}
        experiment = replace(self.experiment, **changes)
        return ExplorerState(experiment, min(self.trial, experiment.trials - 1))

    # ---- circuits

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
        """SHA-256 of the state, including all numbers of its circuits."""
        text = f"{self.trial} {digest(self.control)} {self.digest} {self.experiment.to_toml()}"
        return hashlib.sha256(text.encode()).hexdigest()

    @cached_property
    def alike(self) -> bool:
        """Whether both conditions are the same."""
        control, manipulation = self.experiment.conditions
        same = control.threshold_nats == manipulation.threshold_nats
        return same and self.control == self.circuit

    def check(self) -> None:
        """Raise ValueError for errors that are detectable before a run."""
        if self.alike:
            control, manipulation = self.experiment.conditions
            manipulation.check(control)
        else:
            self.experiment.check_differs()

    # ---- as text

    def link(self, address: str = "") -> str:
        """Return a link to this state: an address and the compressed file of the experiment."""
        packed = zlib.compress(self.experiment.to_toml().encode(), 9)
        code = base64.urlsafe_b64encode(packed).decode().rstrip("=")
        return f"{address}?{QUERY}={code}" + (f"&trial={self.trial}" if self.trial else "")

    @classmethod
    def from_link(cls, link: str) -> ExplorerState:
        """Return the state of a link, or of its part from the question mark on."""
        query = parse_qs(link.partition("?")[2])
        code, trial = query.get(QUERY, [""])[0], query.get("trial", ["0"])[0]
        unpack = zlib.decompressobj()
        try:
            packed = base64.urlsafe_b64decode(code + "=" * (-len(code) % 4))
            text = unpack.decompress(packed, MOST_TEXT).decode()
            if not unpack.eof:
                raise ValueError("incomplete")
        except (ValueError, binascii.Error, zlib.error):
            raise InputError("the link is incomplete: copy it again", "link") from None
        experiment = Experiment.from_text(text, "the link")
        return cls(experiment, int(trial) if trial.isdecimal() else 0)


def opened(name: str | Path) -> ExplorerState:
    """Return the state of a circuit or an experiment, given by name, file or link."""
    text = str(name).strip()
    if f"?{QUERY}=" in text:
        return ExplorerState.from_link(text)
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
    return ExplorerState(_few(experiment))


def _few(experiment: Experiment) -> Experiment:
    """Return an experiment with at most the number of trials that the explorer allows."""
    task = experiment.task
    if isinstance(task, EvidenceTable) or task.trials <= MOST_TRIALS:
        return experiment
    return replace(experiment, task=task.changed(trials=TRIALS))


def of_circuit(name: str) -> ExplorerState:
    """Return a state of an unedited circuit with the default task."""
    path = name.endswith(".toml")
    channels = load_circuit(name).channels if path else 2
    return ExplorerState(
        Experiment(
            name=NAME,
            note=NOTE,
            circuit=CircuitName(name),
            task=Gaussian(channels, trials=TRIALS, t_max=READINGS),
            posterior=POSTERIOR,
            manipulation=Changes(),
        )
    )


class History:
    """The current state of one user, with undo and redo."""

    def __init__(self, first: ExplorerState) -> None:
        first.check()
        self.first = self.state = first
        self.undone: list[ExplorerState] = []
        self.past: list[ExplorerState] = []

    def go(self, state: ExplorerState) -> None:
        """Move to a new state, which discards the states that were undone."""
        if state == self.state and state.key == self.state.key:
            return  # Keys differ if a circuit's file has changed.
        state.check()
        self.past = [*self.past, self.state][-LONGEST:]
        self.state, self.undone = state, []

    def undo(self) -> None:
        """Return to the previous state, if there is one."""
        if self.past:
            self.undone.append(self.state)
            self.state = self.past.pop()

    def redo(self) -> None:
        """Return to the state that was undone last, if there is one."""
        if self.undone:
            self.past.append(self.state)
            self.state = self.undone.pop()

    def reset(self) -> None:
        """Return to the first state; this can be undone."""
        self.go(self.first)
