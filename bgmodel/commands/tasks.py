"""The options of a command that has a task: which task it is, and the settings of all tasks."""

from __future__ import annotations

import ast
import inspect
import textwrap
from dataclasses import fields
from functools import cache, partial
from pathlib import Path
from typing import Any, Literal, get_type_hints

from tyro.constructors import StructConstructorSpec, StructFieldSpec

from bgmodel.tables.given import EvidenceTable
from bgmodel.task import KINDS, Task, kind_of
from circuits.errors import InputError

NAMES = tuple(name for name in KINDS if name != EvidenceTable.name)
TASK = (
    "Gaussian evidence, or a tactile task: are two gratings the same or different, which of N "
    "orientations has a grating, by how many steps was an edge turned, which of N directions does "
    "it have."
)
EVIDENCE = "A table of log-likelihoods, as for `bgmodel decide`, instead of a task."


def of_tasks(default: Task) -> StructConstructorSpec:
    """Return how a task is made from options: its name, and the settings of every kind of task.

    Parameters
    ----------
    default : Task
        The task without any option; other kinds have its settings as far as they have them.
    """
    known = defaults(default)
    kinds = {name: hints[name] for hints in map(get_type_hints, _classes()) for name in hints}
    rows = [StructFieldSpec(name, kinds[name], known[name], _about()[name]) for name in known]
    one: Any = Literal[NAMES]
    path: Any = Path | None
    task = StructFieldSpec("task", one, default.name, TASK)
    own = StructFieldSpec("evidence", path, None, EVIDENCE)
    return StructConstructorSpec(partial(_task, known), (own, task, *rows))


def defaults(default: Task) -> dict[str, Any]:
    """Return every setting of a task that is drawn, with its value in the default task."""
    found: dict[str, Any] = {}
    for kind in _classes():
        for each in sorted(fields(kind), key=lambda one: bool(one.kw_only)):
            found.setdefault(each.name, each.default)
    return found | {each.name: getattr(default, each.name) for each in fields(default)}


def _classes() -> list[type[Task]]:
    return [kind_of(name) for name in NAMES]


def _task(known: dict[str, Any], task: str, evidence: Path | None, **given: Any) -> Task:
    """Return the task of options; ValueError for an option that it does not have."""
    changed = {name: value for name, value in given.items() if value != known[name]}
    if evidence is not None:
        return EvidenceTable(evidence, **_own(EvidenceTable, changed, repr(str(evidence))))
    kind = kind_of(task)
    _own(kind, changed, f"task {task}")
    return Task.of(task, **given)


def _own(kind: type[Task], changed: dict[str, Any], what: str) -> dict[str, Any]:
    has = {each.name for each in fields(kind)}
    for name in sorted(changed.keys() - has):
        if kind is EvidenceTable:
            said = f"{name} is for evidence that is drawn and does not apply to {what}"
            raise InputError(said, name)
        users = [other.name for other in _classes() if name in {f.name for f in fields(other)}]
        if name == "channels":
            raise InputError(f"{what} has {kind.channels} alternatives", name)
        raise InputError(f"{name} is for {', '.join(users)}: {what} does not use it", name)
    return changed


@cache
def _about() -> dict[str, str]:
    """Return the text below each setting in the source, by its name."""
    found: dict[str, str] = {}
    for kind in {parent: None for one in _classes() for parent in one.__mro__[:-1]}:
        (body,) = ast.parse(textwrap.dedent(inspect.getsource(kind))).body
        assert isinstance(body, ast.ClassDef)
        for row, text in zip(body.body, body.body[1:], strict=False):
            if isinstance(row, ast.AnnAssign) and isinstance(text, ast.Expr):
                said = ast.literal_eval(text.value)
                found.setdefault(row.target.id, " ".join(said.split()))  # type: ignore[union-attr]
    return found
