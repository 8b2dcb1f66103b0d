"""The ``bgmodel`` command: a thin layer, whose options come from parameter classes."""

from __future__ import annotations

import io
import os
import re
import sys
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, redirect_stderr
from functools import reduce
from operator import or_
from typing import Annotated, Any

import tyro
from tyro.constructors import (
    ConstructorRegistry,
    PrimitiveConstructorSpec,
    PrimitiveTypeInfo,
    StructConstructorSpec,
    StructTypeInfo,
)

from bgmodel.commands.checks import Writes, check_outputs
from bgmodel.version import __version__
from circuits.errors import InputError

ABOUT = (
    "Test hypotheses about the basal ganglia: run intact and edited circuits on evidence, and "
    "compare their decisions with those of the optimal test. Start with `bgmodel demo`. "
    "`bgmodel --version` prints the version; `bgmodel --tyro-print-completion bash` (or zsh) "
    "prints a script that completes names and options with the tab key."
)


def main(arguments: list[str] | None = None) -> int:
    """Run ``bgmodel``; errors of use are one sentence on stderr, with exit status 2."""
    if isinstance(sys.stdout, io.TextIOWrapper):
        # A terminal may not have every character of a table or of a user's names.
        sys.stdout.reconfigure(errors="backslashreplace")
    if (sys.argv[1:] if arguments is None else arguments) == ["--version"]:
        print(f"bgmodel {__version__}")
        return 0
    try:
        command = parsed(arguments)
        if isinstance(command, Writes):
            check_outputs(command)
        with _plain_warnings():
            command()
    except BrokenPipeError:  # the reader closed the pipe
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except ImportError as error:
        print(f"bgmodel: {error}", file=sys.stderr)
        return 2
    except (ValueError, OSError) as error:
        print(f"bgmodel: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt as stop:
        print(f"bgmodel: stopped. {stop}", file=sys.stderr)
        return 130
    return 0


def parsed(arguments: Sequence[str] | None) -> Callable[[], None]:
    """Return the requested command; ValueError with one sentence if it is invalid.

    A request for help ends the program, as in tyro.
    """
    # Imported within main, which reports in one sentence another package named circuits.
    from bgmodel.commands.table import COMMANDS

    given = sys.argv[1:] if arguments is None else arguments
    _check_named(COMMANDS, given)
    if [word.partition("=")[0] for word in given].count("--edits") > 1:
        raise InputError("--edits is given twice: write all edits after one --edits", "edits")
    printed = io.StringIO()
    try:
        with redirect_stderr(printed):
            command: Callable[[], None] = tyro.cli(
                choices(COMMANDS),
                prog="bgmodel",
                description=ABOUT,
                args=arguments,
                registry=_registry(),
            )
            return command
    except SystemExit as stop:
        if stop.code == 2:
            raise ValueError(_sentence(printed.getvalue())) from None
        raise


def _check_named(top: Mapping[str, Any], arguments: Sequence[str]) -> None:
    """Raise ValueError for help on an unknown command: tyro would show another help."""
    commands: Any = top
    before = "bgmodel"
    if not {"-h", "--help"} & {*arguments}:
        return
    for word in arguments:
        if word.startswith("-") or not isinstance(commands, Mapping):
            return
        if word not in commands:
            other = f" (but there is `bgmodel {word}`)" if word in top else ""
            raise ValueError(
                f"there is no command `{before} {word}`{other}; there are "
                f"{', '.join(f'`{before} {name}`' for name in commands)}"
            )
        before, commands = f"{before} {word}", commands[word]
        commands = commands[1] if isinstance(commands, tuple) else None


def _registry() -> ConstructorRegistry:
    """Return tyro's rules, with additions for whole numbers such as 1e5, names and edits."""
    from bgmodel.commands.tasks import of_tasks
    from bgmodel.names import Name
    from bgmodel.task import Task
    from circuits.declaration.edits import Edits

    registry = ConstructorRegistry()

    @registry.struct_rule
    def tasks(info: StructTypeInfo) -> StructConstructorSpec | None:
        kind, default = info.type, info.default
        return of_tasks(default) if isinstance(kind, type) and issubclass(kind, Task) else None

    @registry.primitive_rule
    def whole(info: PrimitiveTypeInfo) -> PrimitiveConstructorSpec[int] | None:
        if info.type is not int:
            return None
        return PrimitiveConstructorSpec(
            nargs=1,
            metavar="INT",
            instance_from_str=lambda given: _whole(given[0]),
            is_instance=lambda value: isinstance(value, int),
            str_from_instance=lambda value: [str(value)],
        )

    @registry.primitive_rule
    def listed(info: PrimitiveTypeInfo) -> PrimitiveConstructorSpec[Name] | None:
        kind = info.type
        if not (isinstance(kind, type) and issubclass(kind, Name)):
            return None
        return PrimitiveConstructorSpec(
            nargs=1,
            metavar=f"{{{','.join(kind.known())}}}",
            instance_from_str=lambda given: kind.parse(given[0]),
            is_instance=lambda value: isinstance(value, str),
            str_from_instance=lambda value: [str(value)],
        )

    @registry.primitive_rule
    def edits(info: PrimitiveTypeInfo) -> PrimitiveConstructorSpec[Edits] | None:
        if info.type is not Edits:
            return None
        return PrimitiveConstructorSpec(
            nargs="*",
            metavar="EDIT [EDIT ...]",
            instance_from_str=Edits,
            is_instance=lambda value: isinstance(value, Edits),
            str_from_instance=list,
        )

    return registry


def _whole(text: str) -> int:
    try:
        number = float(text)
        if number == int(number):
            return int(text) if text.lstrip("+-").isdecimal() else int(number)
    except (ValueError, OverflowError):
        pass
    raise ValueError(f"it must be a whole number, got {text!r}")


def _sentence(box: str) -> str:
    """Return the first part of tyro's error box as one line."""
    lines = [line.strip("│ ") for line in box.splitlines() if not line.startswith(("╭", "╰"))]
    # If the terminal's encoding has no frames, the title is on its own above a line.
    title = 0 if box.lstrip().startswith("╭") else 1
    parts = re.split(r"[─-]{3,}", " ".join(lines))[title:]
    kept = [parts[0].split("Got errors:")[0], *(p for p in parts[1:] if "Available" in p)]
    text = re.sub(r"(__tyro-dummy-inner__\.)+", "--", " ".join(kept))
    text = re.sub(r"\s+", " ", text).strip().rstrip(".")
    text = re.sub(r"^Error parsing --(\S+): it must", r"\1 must", text)
    text = re.sub(r"^Error parsing \[.*?\]: it must", "the name must", text)
    return f"{text} (bgmodel COMMAND --help lists the options)"


@contextmanager
def _plain_warnings() -> Iterator[None]:
    """Print warnings as one sentence, without their place in the source code."""
    before = warnings.formatwarning
    warnings.formatwarning = lambda message, *where, **more: f"bgmodel: {message}\n"
    try:
        yield
    finally:
        warnings.formatwarning = before


def choices(commands: Mapping[str, Any]) -> Any:
    """Return the type that tyro parses: one subcommand per name, nested for groups."""
    options: list[Any] = []
    for name, command in commands.items():
        about, kind = command if isinstance(command, tuple) else (None, command)
        if isinstance(kind, Mapping):
            kind = choices(kind)
        options.append(
            Annotated[Any, tyro.conf.subcommand(name=name, constructor=kind, description=about)]
        )
    return reduce(or_, options)
