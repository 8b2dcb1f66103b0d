"""Fits of stop-signal data at the terminal: `bgmodel fit --task stop`."""

from __future__ import annotations

from dataclasses import fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

from bgmodel.commands.output import UNRECORDED, recorded, say
from bgmodel.support import files
from circuits.errors import InputError

if TYPE_CHECKING:
    import pandas as pd

    from bgmodel.fitting.stops.model import StopModel
    from bgmodel.stopping.trials import StopTrials

PARAMETERS, PEOPLE = "stop_parameters.csv", "stop_people.csv"
"""Tables of a fit: parameters of each model, and estimates of each participant."""
USED = ("data", "folder", "models", "task", "columns", "noise_nats", *UNRECORDED)
"""Options that have an effect on a fit of stop-signal data, or on its files."""
DEFAULT_MODELS = ("constant_gap", "macaque")
"""Models of two alternatives that are fitted by default, and of stop signals."""


def fit_stop_signals(command: Any) -> None:
    """Fit the stop process of each model to all participants, print it and write its tables.

    Parameters
    ----------
    command : FitRun
        The command, which imports this module.
    """
    from bgmodel.stopping.people import read_people

    unused = {each.name for each in fields(command)} - {*USED}
    command.check_unused(unused, "with --task stop")
    folder = command.folder or Path("fits") / Path(command.data).stem
    paths = [folder / name for name in (PARAMETERS, PEOPLE)]
    for path in paths:
        files.check_new(path, force=command.output.force and files.is_result(path))
    files.check_writable(folder)
    models = {name: _model(name, command.noise_nats) for name in command.models or DEFAULT_MODELS}
    people = read_people(command.data, columns=command.columns)
    texts, parameters, estimates = _fitted(people, models)
    asked = {name: recorded(getattr(command, name)) for name in USED if name not in UNRECORDED}
    asked["folder"] = None
    for table, path in zip((parameters, estimates), paths, strict=True):
        files.write_table(table, path, **asked)
    command.output.show("\n\n".join(texts), parameters)
    command.output.note(f"-> {folder}: {PARAMETERS}, {PEOPLE}")


def _model(name: str, noise_nats: float) -> StopModel:
    """Return the stop process of the test or of a circuit."""
    from bgmodel.fitting.exact.gaps import CONSTANT, GAPS
    from bgmodel.fitting.stops.model import TEST, circuit_stop

    if name in GAPS and name != CONSTANT.name:
        must = "must be of constant_gap, or circuits, for --task stop"
        raise InputError.of("models", must, name)
    return TEST if name == CONSTANT.name else circuit_stop(name, noise_nats)


def _fitted(
    people: dict[str, StopTrials], models: dict[str, StopModel]
) -> tuple[list[str], pd.DataFrame, pd.DataFrame]:
    """Return the summary of each model, the parameters of all, and estimates of participants."""
    import pandas as pd

    from bgmodel.fitting.stops.data import go_processes
    from bgmodel.fitting.stops.fit import fit_stops
    from bgmodel.stopping.people import estimates_of

    say(f"fitting the go trials of {len(people)} participants")
    go = go_processes(people)
    estimates: Any = estimates_of(people).merge(go, on="participant_id")
    texts, tables = [], []
    for name, model in models.items():
        say(f"fitting the stop trials: {name}")
        fit = fit_stops(people, model, go=go)
        texts.append(fit.summary())
        tables.append(fit.parameters().assign(model=name, log_likelihood=fit.log_likelihood))
    return texts, pd.concat(tables, ignore_index=True), estimates
