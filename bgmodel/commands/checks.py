"""Checks and records of options that several commands share."""

from __future__ import annotations

import inspect
import json
import math
import sys
import textwrap
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import MISSING, dataclass, fields, is_dataclass, make_dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, TypeVar, get_type_hints

from bgmodel.support import files, progress
from circuits.errors import InputError, require

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

    from bgmodel.evidence import Evidence
    from bgmodel.integrators.basal_ganglia import BasalGanglia
    from circuits.declaration.edits import Edits

T = TypeVar("T", bound=type)
COMPILES = "compiling, once for this kind of circuit"
"""Message while an engine compiles; the result is cached on disk."""
OUTPUTS = ("output", "drawing", "save", "rates", "spikes", "nwb")
"""Options that name a file to be written, in every command."""
UNRECORDED = (*OUTPUTS, "force", "workers", "seed", "json")
"""Options that do not affect results, and the seed, which is recorded separately."""
FIRST_S, MINUTE_S = 10.0, 60.0
"""When the stage of a long computation is first printed to a log, and how often after that."""
RECORDS = ("setup", "condition")
"""Fields of commands whose own fields are options."""


@dataclass(frozen=True, kw_only=True)
class Writes:
    """A command that writes files."""

    force: bool = False
    """Overwrite existing results."""
    reads: ClassVar[tuple[str, ...]] = ()
    """Options that name an input here, though a result in other commands."""

    def more_outputs(self) -> list[Path]:
        """Return files that are written in addition to those named by options."""
        return []


@dataclass(frozen=True, kw_only=True)
class Shows(Writes):
    """A command that shows its result: a table to read, or JSON for programs."""

    json: bool = False
    """Print one JSON object, the rows of the result under "records", and nothing else on stdout."""

    def show(self, text: str, table: pd.DataFrame, **facts: Any) -> None:
        """Print a result: its text, or all of it as JSON.

        Parameters
        ----------
        text : str
            The result for readers.
        table : DataFrame
            Its rows.
        **facts
            Further facts, as plain values.
        """
        print(json_text(table, **facts) if self.json else text)

    def note(self, text: str) -> None:
        """Print a line in addition to the result; to stderr if the result is JSON."""
        if self.json:
            say(text)
        else:
            print(text)


def json_text(table: pd.DataFrame, **facts: Any) -> str:
    """Return one JSON object: facts, and rows as "records"; unknown values are null."""
    records = json.loads(table.to_json(orient="records", double_precision=15))
    plain = {name: _plain(value) for name, value in facts.items()}
    return json.dumps({**plain, "records": records})


def _plain(value: Any) -> Any:
    """Return a value as JSON has it: paths as text, numbers that are not finite as null."""
    unknown = isinstance(value, float) and not math.isfinite(value)
    return None if unknown else str(value) if isinstance(value, Path) else value


def options_of(command: Any, *, idle: Iterable[str] = (), **settled: Any) -> dict[str, Any]:
    """Return the options that a result was made with, for its provenance.

    Parameters
    ----------
    command : dataclass
        A command.
    idle : names
        Options without effect in this run.
    **settled
        Values of options that the user left open.
    """
    found: dict[str, Any] = {}
    for field in fields(command):
        value = settled.get(field.name, getattr(command, field.name))
        if field.name in RECORDS and field.name not in idle:
            found |= options_of(value)
        elif field.name not in (*RECORDS, *UNRECORDED, *idle) and value is not None:
            found[field.name] = recorded(value)
    return found


def made_with(command: Any, model: BasalGanglia, **settled: Any) -> dict[str, Any]:
    """Return the options and the circuit of a result, for its provenance; see ``options_of``."""
    from bgmodel.integrators.given import identity

    return {"command": options_of(command, **settled), "circuit": identity(model.circuit)}


def recorded(value: Any) -> Any:
    """Return an option as recorded: only what had an effect, and files by name and checksum."""
    if hasattr(value, "used"):
        return {name: recorded(inner) for name, inner in value.used().items()}
    if is_dataclass(value):
        named = {field.name: recorded(getattr(value, field.name)) for field in fields(value)}
        return {"kind": type(value).__name__, **named}
    path = circuit_file(value) if isinstance(value, str) else value
    if isinstance(path, Path) and path.is_file():
        return {"file": path.name, "sha256": files.checksum(path)}
    return {"folder": value.name} if isinstance(value, Path) else value


def circuit_file(name: str) -> Path | None:
    """Return the path of a circuit that is a file; None for the name of a table."""
    return Path(name) if name.endswith(".toml") else None


def check_ending(name: str, path: Path, *allowed: str) -> None:
    """Raise ValueError unless the file of an option ends in one of those allowed."""
    require(path.suffix in allowed, name, f"must end in {' or '.join(allowed)}", str(path))


def showing(whole: str) -> Callable[[T], T]:
    """Return a decorator that shows a whole file in a command's help."""

    def shown(command: T) -> T:
        about, text = inspect.cleandoc(command.__doc__ or ""), textwrap.indent(whole, "    ")
        command.__doc__ = f"{about}\n\nA whole file, which --template writes:\n\n{text}"
        return command

    return shown


def write_template(whole: str, path: str | Path) -> None:
    """Write the file of a command's help to a new file, which is never one that exists."""
    new = Path(path).suffix == ".toml" and not Path(path).exists()
    require(new, "file", "must be a new .toml file, into which --template writes", str(path))
    files.check_writable(Path(path).parent)
    Path(path).write_text(whole, encoding="utf-8")
    print(f"-> {path}")


def check_outputs(command: Writes) -> None:
    """Raise ValueError, before anything is run, if a command's results cannot be written.

    Two options may not name the same file, existing results are overwritten only with ``force``,
    and folders must be writable.
    """
    check_apart(_paths(command))
    names = [name for name in OUTPUTS if name not in command.reads]
    outputs = [getattr(command, name) for name in names if getattr(command, name, None)]
    for path in [*outputs, *command.more_outputs()]:
        # Files that no option names are overwritten only if they are results.
        named = path in outputs or files.is_result(path)
        files.check_new(path, force=command.force and named)
        files.check_writable(path.parent)
    folders = [path.resolve() for _, path in _paths(command) if path.is_dir()]
    for path in outputs:
        if any(folder in path.resolve().parents for folder in folders):
            raise InputError(f"{str(path)!r} is in a folder that is read as input: move it", "path")


def check_apart(paths: Iterable[tuple[str, Path]]) -> None:
    """Raise ValueError if two options, by name, are the same file: one would be overwritten."""
    seen: dict[Path, str] = {}
    for name, path in paths:
        other = seen.setdefault(path.resolve(), name)
        if other != name:
            raise InputError(f"{other} and {name} are the same file, {str(path)!r}", "path")


def _paths(options: Any) -> Iterator[tuple[str, Path]]:
    for field in fields(options):
        value = getattr(options, field.name)
        if field.name == "circuit":
            value = circuit_file(value)
        if isinstance(value, Path):
            yield field.name, value
        elif is_dataclass(value):
            yield from _paths(value)


def plain(model: str) -> str:
    """Return the name of a model, which may be a .toml file, as part of the name of a file."""
    return Path(model).stem if model.endswith(".toml") else model


def say(text: str) -> None:
    """Print a sentence on stderr, prefixed by the program's name."""
    print(f"bgmodel: {text}", file=sys.stderr)


@contextmanager
def stages(what: str) -> Iterator[Callable[[str], None]]:
    """Yield a function that shows the stage of a long computation: in one line at a terminal.

    Elsewhere, such as in the log of a cluster, it prints a line after ``FIRST_S``, and then at most
    once a minute.
    """
    if sys.stderr.isatty():
        from tqdm import tqdm

        with tqdm(desc=what, bar_format="{desc} {elapsed}{postfix}") as bar:
            yield bar.set_postfix_str
        return
    begun = time.monotonic()
    due = begun + FIRST_S

    def tell(stage: str) -> None:
        nonlocal due
        now = time.monotonic()
        if now >= due:
            due = now + MINUTE_S
            after = now - begun
            spent = f"{after:.0f} s" if after < MINUTE_S else f"{after / MINUTE_S:.0f} min"
            say(f"{what}, after {spent}: {stage}")

    yield tell


def save_figure(figure: Figure, path: Path) -> None:
    """Write a figure to a .pdf, .svg or .png file, whole or not at all."""
    from circuits.plots import saved

    # Matplotlib adds its version to a .png.
    more: dict[str, Any] = {"metadata": {"Software": None}} if path.suffix == ".png" else {}
    with files.replacing(path) as partial:
        saved(figure, partial, format=path.suffix[1:], **more)


def check_idle(command: Any, idle: Iterable[str], reason: str) -> None:
    """Raise ValueError for an option among ``idle`` that was given, with what makes it idle."""
    for field in fields(command):
        default = field.default if field.default_factory is MISSING else field.default_factory()
        if field.name in idle and getattr(command, field.name) != default:
            name = field.name.replace("_", "-")
            raise InputError(f"--{name} has no effect with {reason}: leave it out", field.name)


def optional(options: type) -> type:
    """Return a dataclass with the fields of another, each of which is None unless given."""
    kinds = get_type_hints(options)
    return make_dataclass(
        options.__name__,
        [(each.name, kinds[each.name] | None, None) for each in fields(options)],
        bases=(options,),
        frozen=True,
        namespace={"__post_init__": lambda self: None},
    )


def say_of_edits(*edits: Edits) -> None:
    """Explain edits that are easily mistaken for others, once for each kind."""
    for text in dict.fromkeys(note for one in edits for note in one.notes()):
        say(text)


def say_before(what: str, model: BasalGanglia, evidence: Evidence, *, runs: int = 1) -> None:
    """Announce a run of a circuit.

    Parameters
    ----------
    what : str
        The action, such as "comparing".
    model : BasalGanglia
        The circuit.
    evidence : Evidence
        Readings of all trials.
    runs : int
        Number of circuits run on it.

    Raises
    ------
    NoMemoryError
        If there is not enough memory.
    """
    from bgmodel.support.compiling import on_compiling

    if model.raw and evidence.baseline:
        less = f"{evidence.baseline:.3g}"
        say(f"each channel gets its own evidence, minus the baseline of a reading: {less} nats")
    at_once, steps = min(model.batch(evidence), evidence.trials), evidence.steps + 1
    model.check_memory(at_once, steps, evidence.step_ms)
    if model.engine.threaded:
        on_compiling(lambda: say(COMPILES))
    each_s = steps * evidence.step_ms / 1000
    circuits = f"{runs} circuits, " if runs > 1 else ""
    memory = model.memory_gb(at_once, steps, evidence.step_ms)
    say(
        f"{what} {model.circuit.name} on {model.engine}, {circuits}{evidence.trials} trials of up "
        f"to {each_s:.2g} s{f', {memory:.1f} GB of memory' if memory >= 1 else ''}"
    )


@contextmanager
def bar(total: int, unit: str = "trial") -> Iterator[None]:
    """Show a progress bar, on a terminal, of the trials that circuits decide within the block."""
    from tqdm import tqdm

    with tqdm(total=total, unit=unit, disable=None) as shown, progress.shown_by(shown.update):
        yield


def check_whole(**values: int) -> None:
    """Raise ValueError, with its name, for a number below 1."""
    for name, value in values.items():
        require(value >= 1, name, "must be at least 1", value)
