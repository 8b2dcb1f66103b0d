"""Experiments as text: the TOML file that reads back as the same record, and the Python code."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import MISSING, Field, fields, is_dataclass
from pathlib import Path
from typing import Any

from bgmodel.experiments.record import ExperimentRecord
from bgmodel.task import Gaussian, Task
from circuits.declaration.edits import Edits

TO_PREDICT = """
# A prediction, made before the run: remove the marks, and choose a measure, a direction and the
# least change that counts, in the measure's unit.
# [[predictions]]
# measure = "accuracy"
# direction = "down"    # "up", "down", or "none": within +-at_least
# at_least = 0.01
"""
"""Lines that end the file of an experiment without predictions."""


def toml_text(experiment: ExperimentRecord) -> str:
    """Return an experiment as the text of a file; settings at their defaults are left out.

    Paths are written unchanged, so a relative path is read from the folder of the new file.
    """
    import tomlkit

    data = _plain(experiment)
    text = tomlkit.dumps(data)
    return text if experiment.predictions else text + TO_PREDICT


def python_text(experiment: ExperimentRecord) -> str:
    """Return Python code that runs an experiment and prints its measures."""
    used: set[tuple[str, str]] = set()
    made = _code(experiment, used, "")
    used.discard(("bgmodel.experiments.experiment", type(experiment).__name__))
    lines = [f"from {module} import {name}" for module, name in sorted(used)]
    imports = "\n".join(["import bgmodel as bg", *lines])
    return f"{imports}\n\nexperiment = bg.{made}\nprint(experiment.run().summary())\n"


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
