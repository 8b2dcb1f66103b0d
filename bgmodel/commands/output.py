"""Output of commands: results (printed, saved, drawn), their provenance, and messages."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, fields, is_dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from bgmodel.support import files, processes
from bgmodel.support.files import circuit_file, recorded, save_figure
from circuits.errors import InputError, require

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

    from bgmodel.evidence import Evidence
    from bgmodel.integrators.basal_ganglia import BasalGanglia
    from circuits.circuit import Circuit
    from circuits.declaration.edits import Edits

OUTPUTS = ("save", "plot", "save_rates", "save_spikes", "save_nwb")
"""Options that name a file to be written."""
UNRECORDED = (*OUTPUTS, "output", "workers", "seed")
"""Options that do not affect results, and the seed, which is recorded separately."""
FIRST_S, MINUTE_S = 10.0, 60.0
"""When the stage of a long computation is first printed to a log, and how often after that."""
FIGURES, TABLES = (".png", ".pdf", ".svg"), (".csv", ".parquet")
"""Endings of pictures and of tables."""


@dataclass(frozen=True, kw_only=True)
class Files:
    """Files that a command writes."""

    save: Path | None = None
    """File for the result."""
    plot: Path | None = None
    """File for a picture of the result, .png, .pdf or .svg."""
    force: bool = False
    """Overwrite existing results."""

    def check(
        self, endings: Sequence[str] = TABLES, *, more: Mapping[str, Path] = {}, **options: Any
    ) -> None:
        """Raise ValueError, before anything is run, if a result cannot be written.

        ``save`` has one of the endings; without endings it must be absent. ``more`` are files
        that no option names; other options name files that are read, unless in ``OUTPUTS``. No
        result may be the file of another one or of an input.
        """
        if self.save is not None:
            require(endings, "save", "has no effect here: leave it out", str(self.save))
            check_ending("save", self.save, *endings)
        if self.plot is not None:
            check_ending("plot", self.plot, *FIGURES)
        paths = {"save": self.save, "plot": self.plot}
        outputs = paths | {name: options[name] for name in OUTPUTS if name in options}
        named = [path for path in outputs.values() if isinstance(path, Path)]
        read = list(_paths({k: v for k, v in options.items() if k not in OUTPUTS}))
        seen = {path.resolve(): name for name, path in read}
        for name, path in _paths({**outputs, **more}):
            if (other := seen.setdefault(path.resolve(), name)) != name:
                raise InputError(f"{other} and {name} are the same file, {str(path)!r}", "path")
        for path in [*named, *more.values()]:
            # Files that no option names are overwritten only if they are results.
            files.check_new(path, force=self.force and (path in named or files.is_result(path)))
            files.check_writable(path.parent)
        folders = [path.resolve() for _, path in read if path.is_dir()]
        for path in named:
            inside = any(folder in path.resolve().parents for folder in folders)
            require(not inside, "path", "must be outside of a folder that is read", str(path))

    def needed(self, *endings: str, **options: Any) -> Path:
        """Return ``save`` after ``check``; ValueError without it, or with ``plot``."""
        self.unused("plot")
        must = f"must name the file for the result, {' or '.join(endings)}"
        require(self.save is not None, "save", must, None)
        self.check(endings, **options)
        assert self.save is not None
        return self.save

    def unused(self, *names: str) -> None:
        """Raise ValueError for an option, ``save`` or ``plot``, that has no effect here."""
        for name in names:
            path = getattr(self, name)
            require(path is None, name, "has no effect here: leave it out", str(path))

    def note(self, text: str) -> None:
        """Print a line in addition to the result."""
        print(text)

    def write(self, table: pd.DataFrame, seed: int | None = None, **parameters: Any) -> None:
        """Write a table to ``save``, if it is given, with the parameters behind it."""
        if self.save is not None:
            files.write_table(table, self.save, seed=seed, **parameters)
            self.note(f"-> {self.save}")

    def draw(self, figure: Callable[[], Figure]) -> None:
        """Write a picture to ``plot``, if it is given."""
        if self.plot is not None:
            save_figure(figure(), self.plot)
            self.note(f"-> {self.plot}")


@dataclass(frozen=True, kw_only=True)
class Output(Files):
    """What a command does with its result: print it, as text or as JSON, save it, draw it."""

    json: bool = False
    """Print one JSON object, the rows of the result under "records", and nothing else on stdout."""

    def show(self, text: str, table: pd.DataFrame, **facts: Any) -> None:
        """Print a result: its text, or as JSON its table and further facts."""
        whole = {**facts, "records": table}
        print(files.json_text(whole, indent=None, digits=15) if self.json else text)

    def note(self, text: str) -> None:
        """Print a line in addition to the result; to stderr if the result is JSON."""
        (say if self.json else print)(text)


def options_of(**options: Any) -> dict[str, Any]:
    """Return the options that a result was made with, for its provenance.

    Those that were left open, that name results, or that have no effect on them are left out.
    """
    kept: dict[str, Any] = {}
    for name, value in options.items():
        if name in ("setup", "condition"):  # each of their fields is an option
            kept |= options_of(**{one.name: getattr(value, one.name) for one in fields(value)})
        elif name not in UNRECORDED and value is not None:
            kept[name] = recorded(value)
    return kept


def made_with(model: BasalGanglia, **options: Any) -> dict[str, Any]:
    """Return the options and the circuit of a result, for its provenance; see ``options_of``."""
    from circuits.declaration.table_writer import identity

    return {"command": options_of(**options), "circuit": identity(model.circuit)}


def check_ending(name: str, path: Path, *allowed: str) -> None:
    """Raise ValueError unless the file of an option ends in one of those allowed."""
    require(path.suffix in allowed, name, f"must end in {' or '.join(allowed)}", str(path))


def write_template(template: str, path: str | Path) -> None:
    """Write the file of a command's help to a new file, which is never one that exists."""
    new = Path(path)
    fits = new.suffix == ".toml" and not new.exists()
    require(fits, "file", "must be a new .toml file, into which --template writes", str(path))
    files.check_writable(new.parent)
    new.write_text(template, encoding="utf-8")
    print(f"-> {new}")


def _paths(options: Mapping[str, Any]) -> Iterator[tuple[str, Path]]:
    """Yield the files that options name, also those in records of options."""
    for name, option in options.items():
        value = circuit_file(option) if name == "circuit" and option is not None else option
        if isinstance(value, Path):
            yield name, value
        elif is_dataclass(value):
            yield from _paths(vars(value))


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


def check_idle(reason: str, usual: Mapping[str, Any], **options: Any) -> None:
    """Raise ValueError for an option that has no effect but not its usual value, with a reason."""
    for name, value in options.items():
        must = f"has no effect with {reason}: leave it out"
        require(value == usual.get(name), name, must, value)


def say_of_edits(*edits: Edits, circuit: Circuit | None = None) -> None:
    """Explain edits that are easily mistaken for others, and those that act as a criterion."""
    from bgmodel.integrators.criterion import acts_as

    for text in dict.fromkeys(note for one in edits for note in one.notes()):
        say(text)
    if circuit is not None and any(edits) and (shift := acts_as(circuit)):
        say(f"{edits[0].text()}: {shift}")


def say_before(what: str, model: BasalGanglia, evidence: Evidence, *, runs: int = 1) -> None:
    """Announce a run of some circuits; NoMemoryError if there is too little memory."""
    from bgmodel.support.compiling import on_compiling

    if model.engine.threaded:
        on_compiling(lambda: say("compiling, once for this kind of circuit"))
    for line in model.announced(what, evidence, runs):
        say(line)


@contextmanager
def bar(total: int, unit: str = "trial") -> Iterator[None]:
    """Show a progress bar, on a terminal, of the trials that circuits decide within the block."""
    from tqdm import tqdm

    with tqdm(total=total, unit=unit, disable=None) as shown, processes.shown_by(shown.update):
        yield


def check_whole(**values: int) -> None:
    """Raise ValueError, with its name, for a number below 1."""
    for name, value in values.items():
        require(value >= 1, name, "must be at least 1", value)
