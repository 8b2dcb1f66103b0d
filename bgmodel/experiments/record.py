"""The declaration of an experiment: shared settings, changes of each condition, and its text."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import MISSING, Field, dataclass, field, fields, is_dataclass
from pathlib import Path
from typing import Any

import pandas as pd

from bgmodel.conditions import Observed
from bgmodel.deciding.calibration import calibration
from bgmodel.deciding.measures import OF_STOP
from bgmodel.evidence import needed_truth
from bgmodel.experiments.expected import Expected
from bgmodel.task import Gaussian, Task
from bgmodel.trials.named_evidence import NamedEvidence
from bgmodel.trials.task_trials import EvidenceTable
from circuits.declaration.edits import Edits
from circuits.errors import InputError, require

MANY_MISSED = 0.05
"""Warn if a larger share of trials has no decision in time."""


UNCHANGED = "no decision differs between control and manipulation"


CONDITIONS = ("control", "manipulation", "change")


@dataclass(frozen=True)
class Changes:
    """The changes of a condition: edits of the circuit, and its stopping posterior."""

    edits: Edits = field(default_factory=Edits)
    """Differences from the table, one line each."""
    posterior: float | None = None
    """Stopping posterior, if it differs: models an instruction."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "edits", Edits(self.edits))


@dataclass(frozen=True, kw_only=True)
class ExperimentRecord(Observed):
    """A control, a manipulation and predictions; all other settings are shared."""

    name: str
    """The manipulation in a few words."""
    note: str
    """Why the manipulation models the published one, and where the sizes come from."""
    manipulation: Changes
    """Changes made by the manipulation."""
    control: Changes = Changes()
    """Changes made by the control."""
    predictions: tuple[Expected, ...] = ()
    """Predictions, made before the run; without any there is a report and no verdict."""
    published: str = ""
    """The published result; empty if the question is new."""
    source: str = ""
    """Its source, and whether the paper or only its abstract was read."""
    effects: tuple[Expected, ...] = ()
    """The published result as numbers, if there are any."""
    truth: int | None = None
    """The hypothesis that is true in every trial that counts; each in turn by default."""

    def __post_init__(self) -> None:
        super().__post_init__()
        for prediction in self.predictions:
            must = "must be up, down or none in a prediction"
            require(prediction.direction is not None, "direction", must, None)
        for effect in self.effects:
            known = effect.direction is None and bool(effect.source)
            require(known, "effects", "must have a value and a source", effect.measure)
        told = [(effect.measure, effect.unit) for effect in self.effects]
        once = len(set(told)) == len(told)
        require(once, "effects", "must give a measure in one unit once", told)
        if self.stop is None:
            must = "must be one of a task without stop signals: there is no [stop]"
            for measure in [one.measure for one in self.predictions] + [one[0] for one in told]:
                require(measure not in OF_STOP, "measure", must, measure)
        for name in ("control", "manipulation"):
            must, changes = "must be Changes(edits=[...])", getattr(self, name)
            require(isinstance(changes, Changes), name, f"{must} of {__name__}", changes)
        if not isinstance(self.task, EvidenceTable):
            self._check_truth(self.task.channels)
        for changes in (self.control, self.manipulation):
            self.condition(changes)

    def condition(self, changes: Changes) -> Observed:
        """Return the control or the manipulation as a condition."""
        posterior = self.posterior if changes.posterior is None else changes.posterior
        shared = {each.name: getattr(self, each.name) for each in fields(Observed)}
        edits = Edits((*self.edits, *changes.edits))
        return Observed(**shared | {"edits": edits, "posterior": posterior})

    @property
    def conditions(self) -> tuple[Observed, Observed]:
        """Control and manipulation."""
        return self.condition(self.control), self.condition(self.manipulation)

    def check_differs(self) -> None:
        """Raise ValueError if both conditions are alike, or a threshold is not allowed.

        ``run`` refuses the latter too; this check comes before the run is announced.
        """
        control, manipulation = self.conditions
        self.given()
        alike = control.threshold_nats == manipulation.threshold_nats
        if alike and control.edited == manipulation.edited:
            message = "the manipulation changes nothing: control and manipulation are alike"
            if self.stop is not None:
                course = f"add {self.stop.nucleus} amount=-2 from_ms=200 to_ms=400"
                message += f", [stop] included; input of one of them is an edit, such as {course!r}"
            raise InputError(message, "manipulation")
        manipulation.check(control)

    def given(self) -> NamedEvidence:
        """Return the evidence with the names of its hypotheses and further columns of a table."""
        named = self.drawn("experiment")
        drawn = named.evidence
        truth = needed_truth(drawn)
        self._check_truth(drawn.hypotheses)
        return named if self.truth is None else named.where(truth == self.truth)

    def to_toml(self) -> str:
        """Return the experiment as the text of a file, from which ``from_text`` makes it again.

        Settings at their defaults are left out. Paths are written unchanged, so a relative path is
        read from the folder of the new file.
        """
        import tomlkit

        text = tomlkit.dumps(_plain(self))
        return text if self.predictions else text + TO_PREDICT

    def to_python(self) -> str:
        """Return Python code that runs the experiment and prints its measures."""
        used: set[tuple[str, str]] = set()
        made = _code(self, used, "")
        used.discard(("bgmodel.experiments.experiment", type(self).__name__))
        lines = [f"from {module} import {name}" for module, name in sorted(used)]
        imports = "\n".join(["import bgmodel as bg", *lines])
        return f"{imports}\n\nexperiment = bg.{made}\nprint(experiment.run().summary())\n"

    def _check_truth(self, hypotheses: int) -> None:
        if self.truth is not None and self.truth not in range(hypotheses):
            raise InputError.of("truth", f"must be within 0..{hypotheses - 1}", self.truth)

    @property
    def stopping(self) -> str:
        """The posterior at which both conditions decide, or that of each, as text."""
        texts = [condition.stopping for condition in self.conditions]
        return texts[0] if texts[0] == texts[1] else f"{texts[0]} (control), {texts[1]}"


def unchanged(table: pd.DataFrame) -> bool:
    """Whether every known change is 0 with an interval of 0, so that no decision differs."""
    change = table.loc[table["condition"] == CONDITIONS[2], ["value", "low", "high"]]
    known = change[change["value"].notna()]
    return bool(len(known) and (known == 0).all(axis=None))


def uncalibrated(experiment: ExperimentRecord, table: pd.DataFrame) -> str:
    """Return a warning if posteriors at the decision are not calibrated, or an empty string.

    If only one truth counts there is none, since one kind of error is missing.
    """
    values = table.set_index(["condition", "measure"])["value"]
    for condition in CONDITIONS[:2] if experiment.truth is None else ():
        names = ("mean_posterior", "accuracy", "decided")
        posterior, accuracy, decided = (float(values[condition, name]) for name in names)
        if warning := calibration(posterior, accuracy, decided):
            return f"{condition}: {warning}"
    return ""


TO_PREDICT = """
# A prediction, made before the run: remove the marks, and choose a measure, a direction and the
# least change that counts, in the measure's unit.
# [[predictions]]
# measure = "accuracy"
# direction = "down"    # "up", "down", or "none": within +-at_least
# at_least = 0.01
"""
"""Lines that end the file of an experiment without predictions."""


def _changed(record: Any) -> Iterator[tuple[str, Any]]:
    """Yield the fields of a record that differ from their defaults, plain ones before records."""
    changed = [
        (f.name, getattr(record, f.name)) for f in fields(record) if not _is_default(f, record)
    ]
    yield from sorted(changed, key=lambda pair: _is_table(pair[1]))


def _is_default(field: Field[Any], record: Any) -> bool:
    value = getattr(record, field.name)
    if field.default_factory is not MISSING:
        return bool(value == field.default_factory())
    return field.default is not MISSING and bool(value == field.default)


def _is_table(value: Any) -> bool:
    """Whether TOML writes a value under a heading, after all plain values."""
    return is_dataclass(value) or (isinstance(value, tuple) and any(map(is_dataclass, value)))


def _plain(value: Any) -> Any:
    """Return a value as TOML has it."""
    if isinstance(value, Task) and not isinstance(value, Gaussian):
        return {"name": value.name} | {name: _plain(inner) for name, inner in _changed(value)}
    if is_dataclass(value):
        # None has no TOML; a field that may be None has it as its default.
        return {name: _plain(inner) for name, inner in _changed(value) if inner is not None}
    if isinstance(value, Mapping):
        return {name: _plain(inner) for name, inner in value.items()}
    if isinstance(value, (tuple, list)):
        return [_plain(inner) for inner in value]
    return str(value) if isinstance(value, (Path, str)) else value


def _code(value: Any, used: set[tuple[str, str]], indent: str) -> str:
    """Return the Python expression of a value; the names that it needs are added to ``used``."""
    if is_dataclass(value) or isinstance(value, (Edits, Path)):
        kind = Path if isinstance(value, Path) else type(value)
        used.add(("pathlib" if kind is Path else kind.__module__, kind.__name__))
        if isinstance(value, Path):
            return f"Path({str(value)!r})"
        if isinstance(value, Edits):
            return f"Edits({list(map(str, value))!r})"
        deeper = indent + "    "
        lines = [f"{deeper}{n}={_code(v, used, deeper)},\n" for n, v in _changed(value)]
        return f"{kind.__name__}(\n{''.join(lines)}{indent})" if lines else f"{kind.__name__}()"
    if isinstance(value, tuple):
        return f"({''.join(f'{_code(inner, used, indent)}, ' for inner in value)})"
    return repr(str(value)) if isinstance(value, str) else repr(value)
