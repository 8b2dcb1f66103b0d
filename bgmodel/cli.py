"""The ``bgmodel`` command: parse arguments, run the command, report errors in one sentence."""

from __future__ import annotations

import ast
import io
import os
import sys
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import cache, partial
from importlib import import_module
from importlib.resources import files
from textwrap import indent
from typing import Any, get_args, get_origin

from cyclopts import (
    App,
    CoercionError,
    CycloptsError,
    MissingArgumentError,
    Parameter,
    UnknownCommandError,
    UnusedCliTokensError,
)

from bgmodel.support import __version__
from bgmodel.support.toml_files import as_toml
from circuits.errors import InputError, nearest, require

ABOUT = (
    "Test hypotheses about the basal ganglia: run intact and edited circuits on evidence, and "
    "compare their decisions with those of the optimal test. Start with `bgmodel demo`. "
    "`bgmodel --completion bash` (zsh, fish) prints a script that completes names and options."
)
COMMANDS: dict[str, str | dict[str, str]] = {
    "demo": "pictures:demo",
    "touch": {
        "": "touch:touch",
        "simulate": "touch_steps:simulate",
        "train": "touch_steps:train",
        "decode": "touch_steps:decode",
        "watch": "touch:watch",
    },
    "circuit": {"show": "circuit:show", "run": "circuit:run", "export": "circuit:export"},
    "decide": "decide:decide",
    "compare": "decide:compare",
    "learn": "decide:learn",
    "fit": "fit:fit",
    "experiment": "experiments:experiment",
    "sweep": "experiments:sweep",
    "exam": "experiments:exam",
    "explore": "pictures:explore",
    "figures": "pictures:figures",
}
"""Each command: the module within ``bgmodel.commands`` and the function; of a group, those of its
commands, and under "" of the group itself."""
TEMPLATES = {"experiment": "bgmodel.experiments.experiment", "sweep": "bgmodel.sweeps.sweep"}
"""Commands whose help shows a whole file, and the modules that have it."""
GROUPS = {"circuit": "Show a circuit's table, run it on evidence, or export it to Brian2."}


def main(arguments: list[str] | None = None) -> int:
    """Run ``bgmodel``; errors of use are one sentence on stderr, with exit status 2."""
    if isinstance(sys.stdout, io.TextIOWrapper):
        # A terminal may not have every character of a table or of a user's names.
        sys.stdout.reconfigure(errors="backslashreplace")
    words = sys.argv[1:] if arguments is None else arguments
    try:
        run(words)
    except BrokenPipeError:  # the reader closed the pipe
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        if any(word.startswith("--save") for word in words):
            print("bgmodel: stopped, since its output was read no further", file=sys.stderr)
            return 2
        return 0
    except (ImportError, ValueError, OSError) as error:
        print(f"bgmodel: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt as stop:
        print(f"bgmodel: stopped. {stop}", file=sys.stderr)
        return 130
    return 0


def run(words: Sequence[str]) -> None:
    """Run the command that the arguments name; errors: see ``parsed``, and those of it."""
    with _plain_warnings():
        parsed(words)()
    if {"-h", "--help"} & {*words} and words[0] in TEMPLATES:
        template = getattr(import_module(TEMPLATES[words[0]]), words[0].title()).template()
        print(f"A whole file, which --template writes:\n\n{indent(template, '    ')}")


def parsed(arguments: Sequence[str]) -> partial[None]:
    """Return the command of some arguments, with the arguments of its function.

    Raises
    ------
    ValueError
        With one sentence, for arguments that the command does not have or that it refuses.
    """
    if arguments[:1] == ["--completion"]:
        return partial(_print_completion, *arguments[1:2])
    try:
        app = application(arguments)
        words = _whole_numbers(app, arguments)
        command, bound, _ = app.parse_args(words, exit_on_error=False, print_error=False)
    except CycloptsError as error:
        if isinstance(error.__cause__, InputError):
            raise error.__cause__ from None
        # Once anything has imported pydantic, it checks values before the command does.
        (wrong, *_) = getattr(error.__cause__, "errors", list)() or [{"msg": ""}]
        _, _, says = wrong["msg"].partition("Value error, it ")
        if says and isinstance(error, CoercionError) and error.argument is not None:
            field = error.argument.name.lstrip("-").replace("-", "_")
            raise InputError(f"{field} {says}", field) from None
        named = _named(arguments)
        about = f"`bgmodel {' '.join([*named, '--help'])}` lists what there is"
        raise InputError(f"{_sentence(error)}; {about}", "arguments") from None
    return partial(command, *bound.args, **bound.kwargs)


def _named(words: Sequence[str]) -> Sequence[str]:
    """Return the words of the arguments that name a command; none if they name nothing."""
    inner = COMMANDS.get(words[0]) if words else None
    nested = isinstance(inner, dict) and words[1:2] and words[1] in inner
    return words[: 2 if nested else 1] if inner is not None else []


def _whole_numbers(app: App, arguments: Sequence[str]) -> list[str]:
    """Return arguments with whole numbers such as 1e5 written in full; ValueError for fractions."""
    words = list(arguments)
    if not (named := _named(arguments)) or "--help" in words:
        return words
    parser = app[named[0]] if len(named) == 1 else app[named[0]][named[1]]
    if parser.default_command is None:
        return words
    counts = {name for one in parser.assemble_argument_collection()
              if int in (one.hint, *get_args(one.hint)) and get_origin(one.hint) is not tuple
              for name in one.names}  # fmt: skip
    for k, word in enumerate(words):
        option, equals, text = word.partition("=")
        if option in counts and equals:
            words[k] = f"{option}={_whole(option, text)}"
        elif k and words[k - 1] in counts and not word.startswith("--"):
            words[k] = _whole(words[k - 1], word)
    return words


def _whole(option: str, text: str) -> str:
    number, name = as_toml(text), option.lstrip("-").replace("-", "_")
    require(type(number) is int, name, "must be a whole number", text)
    return str(number)


def _print_completion(shell: Any = "") -> None:
    known = ("bash", "zsh", "fish")
    require(shell in known, "completion", f"must be one of {', '.join(known)}", shell)
    print(application(["all"]).generate_completion(prog_name="bgmodel", shell=shell))


def application(words: Sequence[str] = ()) -> App:
    """Return the parser of all commands, which imports only the one that is run.

    Parameters
    ----------
    words : sequence of str
        The arguments, of which the first name the command; ("all",) imports every command.
    """
    usual = Parameter(negative_bool=(), negative_iterable=(), show_default=_default)
    app = App(name="bgmodel", help=ABOUT, version=f"bgmodel {__version__}",
              help_format="markdown", default_parameter=usual)  # fmt: skip
    for order, (name, place) in enumerate(COMMANDS.items()):
        if isinstance(place, str):
            _add(app, (name,), place, words, order)
            continue
        about = _about(place[""]) if "" in place else GROUPS[name]
        chosen = "" in place and (words[:1] == ["all"] or words[:1] == [name])
        group = App(name=name, help=None if chosen else about, sort_key=order)
        for inner, function in place.items():
            if inner:
                _add(group, (name, inner), function, words, order)
            elif chosen:
                group.default(_function(function))
        app.command(group)
    return app


def _add(app: App, words: tuple[str, ...], place: str, typed: Sequence[str], order: int) -> None:
    """Add a command: its function if it is to be run, otherwise its import path."""
    if typed[:1] == ["all"] or (*typed[: len(words)],) == words:
        app.command(_function(place), name=words[-1], sort_key=order)
    else:
        about = _about(place)
        app.command(f"bgmodel.commands.{place}", name=words[-1], help=about, sort_key=order)


def _function(place: str) -> Callable[..., None]:
    module, name = place.split(":")
    command: Callable[..., None] = getattr(import_module(f"bgmodel.commands.{module}"), name)
    return command


def _default(value: Any) -> str | None:
    """Return a default as help shows it; None for one that says nothing."""
    if value is None or value is False or value in ("", ()):
        return None
    if isinstance(value, tuple):
        return " ".join(map(str, value))
    return f"{value:g}" if isinstance(value, float) else str(value)


@cache
def _about(place: str) -> str:
    """Return the first line of a command's docstring, without importing its module."""
    module, name = place.split(":")
    source = files("bgmodel.commands").joinpath(f"{module}.py").read_text(encoding="utf-8")
    (command,) = (
        each for each in ast.parse(source).body
        if isinstance(each, ast.FunctionDef) and each.name == name
    )  # fmt: skip
    return (ast.get_docstring(command) or "").partition("\n")[0]


def _sentence(error: CycloptsError) -> str:
    """Return an error of use as one sentence."""
    if isinstance(error, UnknownCommandError):
        wrong = (error.unused_tokens or [""])[0]
        *_, above = ("", *(error.command_chain or ()))
        inner = COMMANDS.get(above, "")
        names = [name for name in (inner if isinstance(inner, dict) else COMMANDS) if name]
        where, near = f" of {above}" if isinstance(inner, dict) else "", nearest(wrong, names)
        if where and wrong in COMMANDS:
            near = f" (bgmodel {wrong} is one)"
        return f"there is no command {wrong!r}{where}{near}; there are {', '.join(names)}"
    if isinstance(error, MissingArgumentError) and error.keyword:
        return f"{error.keyword} needs a value, or settings (name=value), after it"
    if isinstance(error, UnusedCliTokensError):
        words = " ".join(map(repr, error.unused_tokens or ()))
        return (
            f"{words} is not expected here: a result is saved by --save FILE, a circuit is named "
            "by --circuit, a table of evidence by --task FILE"
        )
    return " ".join(str(error).split()).rstrip(".,; ")


@contextmanager
def _plain_warnings() -> Iterator[None]:
    """Print warnings as one sentence, without their place in the source code."""
    before = warnings.formatwarning
    warnings.formatwarning = lambda message, *where, **more: f"bgmodel: {message}\n"
    try:
        yield
    finally:
        warnings.formatwarning = before


def commands(app: App | None = None, before: str = "") -> Iterator[tuple[str, App]]:
    """Yield the name and the parser of every command."""
    app = application(["all"]) if app is None else app
    if app.default_command is not None and before:
        yield before, app
    for name in app:
        if not name.startswith("-"):
            yield from commands(app[name], f"{before} {name}".strip())
