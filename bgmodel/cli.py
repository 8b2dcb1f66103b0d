"""The ``bgmodel`` command: thin, its options come from the parameter classes."""

from __future__ import annotations

import sys
import warnings
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from functools import reduce
from operator import or_
from typing import Annotated, Any

import tyro

from bgmodel.commands.checks import check_apart
from bgmodel.commands.circuit import Run, Show
from bgmodel.commands.comparing import Compare, Lesion
from bgmodel.commands.decisions import Decide, Learn
from bgmodel.commands.dopamine import Learn as Dopamine
from bgmodel.commands.experiments import Run as Experiment
from bgmodel.commands.figures import Figures
from bgmodel.commands.taps import Decode, Simulate, Train

ABOUT = "From a tactile tap to a learned decision: simulate, train, decode, decide, learn, draw."
CIRCUIT = {"show": Show, "run": Run, "lesion": Lesion, "learn": Dopamine}
# A name and its command, or a name and a group: what it is about, and a table like this one with
# two commands or more.
COMMANDS: dict[str, Any] = {
    "simulate": Simulate,
    "train": Train,
    "decode": Decode,
    "decide": Decide,
    "learn": Learn,
    "circuit": (
        "A basal ganglia circuit: show its table, let it decide, lesion it, let dopamine learn. "
        "Example: bgmodel circuit show",
        CIRCUIT,
    ),
    "compare": Compare,
    "experiment": Experiment,
    "figures": Figures,
}


def main(arguments: list[str] | None = None) -> int:
    """Run ``bgmodel``; errors of use are one sentence on stderr, with exit status 2."""
    command: Callable[[], None] = tyro.cli(
        choices(COMMANDS), prog="bgmodel", description=ABOUT, args=arguments
    )
    try:
        check_apart(command)
        with _plain_warnings():
            command()
    except (ValueError, ImportError, OSError) as error:
        print(f"bgmodel: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt as stop:
        print(f"bgmodel: stopped. {stop}", file=sys.stderr)
        return 130
    return 0


@contextmanager
def _plain_warnings() -> Iterator[None]:
    """Say warnings as a sentence, without the place in the sources that they come from."""
    before = warnings.formatwarning
    warnings.formatwarning = lambda message, *where, **more: f"bgmodel: {message}\n"
    try:
        yield
    finally:
        warnings.formatwarning = before


def choices(commands: Mapping[str, Any]) -> Any:
    """Return the type that tyro parses: one subcommand a name, one level more for a group."""
    options: list[Any] = []
    for name, command in commands.items():
        about, kind = command if isinstance(command, tuple) else (None, command)
        if isinstance(kind, Mapping):
            kind = choices(kind)
        options.append(
            Annotated[Any, tyro.conf.subcommand(name=name, constructor=kind, description=about)]
        )
    return reduce(or_, options)
