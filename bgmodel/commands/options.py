"""How arguments of Python functions are written at the terminal."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import fields, replace
from functools import cache, partial, wraps
from pathlib import Path
from typing import Annotated, Any, TypeVar, cast, get_args, get_type_hints

from cyclopts import Parameter
from docstring_parser import parse, parse_from_object

from bgmodel.support import toml_files
from bgmodel.task import KINDS, Gaussian, Task, kind_of
from circuits.declaration.edits import Edits
from circuits.errors import InputError, nearest, require

T = TypeVar("T")
FLAT = Parameter(name="*")
"""For a record each of whose fields is an option."""
MANY = Parameter(consume_multiple=(1, None), negative=())
"""For an option that takes all words up to the next option."""
OFF = Parameter(negative_bool="no-")
"""For an option that is on by default."""
Workers = Annotated[
    int, Parameter(help="Processes or threads; the results do not depend on their number.")
]
Edited = Annotated[
    Edits, Parameter(help='Edits of the circuit, each in quotes: "lesion STN 10%" "dopamine 0.9".')
]
TABLES = (".csv", ".tsv", ".parquet")
TASKS = tuple(name for name in KINDS if name != "table")
TASK = (
    f"The task: {', '.join(TASKS[:-1])} or {TASKS[-1]}, and its settings, as in "
    "`--task orientation channels=4 trials=200`; settings alone change the default; or the file of "
    "an evidence table."
)


def settings(words: Iterable[str]) -> dict[str, str]:
    """Return settings written as name=value."""
    values_by_name: dict[str, str] = {}
    for word in words:
        name, equals, value = word.partition("=")
        name = name.strip().replace("-", "_")
        require(equals and name, "settings", "must be written as name=value", word)
        require(name not in values_by_name, name, "must be given once", word)
        values_by_name[name] = value.strip()
    return values_by_name


def typed(texts: Mapping[str, str], kind: type) -> dict[str, Any]:
    """Return settings as a file would have them: text and paths as written, others as in TOML."""
    hints = get_type_hints(kind)
    written = {name for name in texts
               if {str, Path} & {hints.get(name), *get_args(hints.get(name))}}  # fmt: skip
    return {k: text if k in written else toml_files.as_toml(text) for k, text in texts.items()}


def record_of(usual: T, words: Sequence[str]) -> T:
    """Return a record with the settings of some words, and others as usual."""
    kind = type(usual)
    known = [each.name for each in fields(kind)]  # type: ignore[arg-type]
    return replace(usual, **values(words, kind, known))  # type: ignore[type-var]


def values(words: Sequence[str], kind: type, known: Sequence[str]) -> dict[str, Any]:
    """Return the settings of some words, with the types that a record has for them."""
    texts, hints = settings(words), get_type_hints(kind)
    for name in texts:
        if name not in known:
            there = f"there are {', '.join(known)}"
            raise InputError(f"there is no setting {name!r}{nearest(name, known)}; {there}", name)
    parsed = typed(texts, kind)
    return {name: toml_files.value(value, hints[name], name) for name, value in parsed.items()}


def task_of(usual: Task, words: Sequence[str]) -> Task:
    """Return a task from its words: its name or the file of a table, and its settings.

    Without a name it is of the usual kind; other kinds have the usual settings, as far as they have
    them, but for the number of alternatives.
    """
    settings_given = settings(word for word in words if "=" in word)
    names = [word for word in words if "=" not in word] or [usual.name]
    require(len(names) == 1, "task", "must be a single one", " ".join(names))
    name = names[0]
    if Path(name).suffix in TABLES:
        return Task.from_settings({"evidence": name} | typed(settings_given, kind_of("table")))
    must = f"must be one of {', '.join(TASKS)}, or the file of an evidence table"
    require(name in TASKS, "task", must, name)
    kind, fields_of_kind = kind_of(name), {each.name for each in fields(kind_of(name))}
    left_out = {"channels"} if name != usual.name else set()
    shared = {k: v for k, v in usual.settings().items() if k in fields_of_kind - left_out}
    return Task.from_settings(shared | typed(settings_given, kind) | {"name": name})


def _of_words(made: Callable[[list[str]], Any], **more: Any) -> Any:
    """Return the annotation of an option whose value is made from all words up to the next one."""
    return Parameter(
        converter=lambda kind, tokens: made([token.value for token in tokens]),
        n_tokens=-1, consume_multiple=(1, None), accepts_keys=False, negative=(), **more,
    )  # fmt: skip


def task(usual: Task) -> Any:
    """Return the annotation of a task option whose default is ``usual``."""
    made = partial(task_of, usual)
    return _of_words(made, help=TASK, show_default=lambda value: value.text if value else "")


def record(usual: Any, about: str) -> Any:
    """Return the annotation of a record, usually ``usual``, written as name=value for fields."""

    def shown(value: Any) -> str:
        if isinstance(value, tuple):
            return ",".join(map(shown, value))
        return f"{value:g}" if isinstance(value, float) else str(value)

    text = " ".join(f"{f.name}={shown(getattr(usual, f.name))}" for f in fields(usual))
    made = partial(record_of, usual)
    return _of_words(made, help=f"{about} By default {text}.", show_default=False)


def like(function: Callable[..., Any], *names: str, **usual: Any) -> Callable[[T], T]:
    """Return a decorator that gives a command parameters of a function.

    Each keeps its type, unless ``usual`` has another, its default and its description; the command
    receives them in its ``**options``.
    """

    def decorated(command: T) -> T:
        target: Any = command
        signature, about = inspect.signature(target), described(function)
        defaults = {name: inspect.signature(function).parameters[name].default for name in names}
        usual_values = {k: v for k, v in defaults.items() if v is not inspect.Parameter.empty}
        hints, theirs = get_type_hints(target, include_extras=True), get_type_hints(function)
        own = [one for one in signature.parameters.values() if one.kind is not one.VAR_KEYWORD]
        kept: list[inspect.Parameter] = []
        for name in names:
            kind = usual.get(name, theirs[name])
            text = Parameter(help=about.get(name, ""))
            many = kind in (Sequence[float], Sequence[str], tuple[str, ...], tuple[str, ...] | None)
            hints[name] = Annotated[(kind, MANY, text) if many else (kind, text)]
            how: Any = {"default": defaults[name], "annotation": hints[name]}
            kept.append(inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, **how))
        hints.pop("options", None)

        @wraps(target)
        def filled(*args: Any, **options: Any) -> Any:
            return target(*args, **(usual_values | options))

        order = sorted([*kept, *own], key=lambda one: one.kind)
        filled.__signature__ = signature.replace(parameters=order)  # type: ignore[attr-defined]
        filled.__annotations__ = hints
        return cast(T, filled)

    return decorated


@cache
def described(function: Callable[..., Any]) -> dict[str, str]:
    """Return the description of each parameter in the docstring of a function."""
    descriptions: dict[str, str] = {}
    of_fields = isinstance(function, type)  # documented one by one
    docs = parse_from_object(function) if of_fields else parse(inspect.getdoc(function) or "")
    for one in docs.params:
        text = " ".join((one.description or "").split()).replace("``", "")
        descriptions |= dict.fromkeys([name.strip() for name in one.arg_name.split(",")], text)
    return descriptions


def _edits_of(words: list[str]) -> Edits:
    """Return edits; one that the shell has split is named as that."""
    try:
        return Edits(words)
    except InputError as error:
        if len(words) < 2 or all(" " in word for word in words):
            raise
        advice = f'{error}; put each edit in quotes: --edits "{" ".join(words)}"'
        raise InputError(advice, error.field, error.given) from None


task(Gaussian())(Task)
_of_words(_edits_of, show_default=False, allow_repeating=False)(Edits)
