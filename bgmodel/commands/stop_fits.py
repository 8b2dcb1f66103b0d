"""Fits of stop-signal data at the terminal: `bgmodel fit --task stop`."""

from __future__ import annotations

from dataclasses import fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

from bgmodel.commands.output import UNRECORDED, recorded, say
from bgmodel.support import files
from circuits.errors import DataWarning, InputError, within

if TYPE_CHECKING:
    import pandas as pd

    from bgmodel.fitting.likelihood import Likelihood
    from bgmodel.fitting.stops.model import StopModel
    from bgmodel.trials.record import Trials

PARAMETERS, PEOPLE = "stop_parameters.csv", "stop_people.csv"
"""Tables of a fit: parameters of each model, and estimates of each participant."""
USED = ("data", "folder", "models", "task", "columns", "noise_nats", *UNRECORDED)
"""Options that have an effect on a fit of stop-signal data, or on its files."""
DEFAULT_MODELS = ("constant_gap", "macaque")
"""Models of two alternatives that are fitted by default, and of stop signals."""


def fit_stop_signals(command: Any) -> None:
    """Fit the stop process of each model, print it and write its tables.

    Three participants or more are fitted in a hierarchy, fewer one by one.

    Parameters
    ----------
    command : FitRun
        The command, which imports this module.
    """
    from bgmodel.fitting.stops.model import stop_model
    from bgmodel.trials.reading import read_trials

    unused = {each.name for each in fields(command)} - {*USED}
    command.check_unused(unused, "with --task stop")
    folder = command.folder or Path("fits") / Path(command.data).stem
    paths = [folder / name for name in (PARAMETERS, PEOPLE)]
    for path in paths:
        files.check_new(path, force=command.output.force and files.is_result(path))
    files.check_writable(folder)
    names = command.models or DEFAULT_MODELS
    models = {name: stop_model(name, command.noise_nats) for name in names}
    people = read_trials(command.data, columns=command.columns).by_participant()
    texts, parameters, estimates = _fitted(people, models)
    asked = {name: recorded(getattr(command, name)) for name in USED if name not in UNRECORDED}
    asked["folder"] = None
    for table, path in zip((parameters, estimates), paths, strict=True):
        files.write_table(table, path, **asked)
    command.output.show("\n\n".join(texts), parameters)
    command.output.note(f"-> {folder}: {PARAMETERS}, {PEOPLE}")


def _fitted(
    people: dict[str, Trials], models: dict[str, StopModel]
) -> tuple[list[str], pd.DataFrame, pd.DataFrame]:
    """Return a text on each model, the parameters of all, and estimates of participants."""
    import pandas as pd

    from bgmodel.stopping.people import estimates_of
    from bgmodel.stopping.trials import StopTrials

    estimates = estimates_of({who: StopTrials.of(trials) for who, trials in people.items()})
    texts, tables = [], []
    for name, model in models.items():
        say(f"fitting the stop trials: {name}")
        table, own = _fit(_likelihoods(people, model))
        texts.append(f"{name}: {len(own)} participants\n{table.round(3).to_string(index=False)}")
        tables.append(table.assign(model=name))
        estimates = estimates.merge(own.add_suffix(f"_{name}").reset_index(), how="left")
    texts.append("ssrt_ms includes afferent and motor delays, which such data cannot separate")
    return texts, pd.concat(tables, ignore_index=True), estimates


def _likelihoods(people: dict[str, Trials], model: StopModel) -> dict[str, Likelihood]:
    """Return the likelihood of each participant who has enough trials; warn of the others."""
    from bgmodel.fitting.stops.race import likelihood

    found: dict[str, Likelihood] = {}
    for who, trials in people.items():
        try:
            found[who] = likelihood(model, trials)
        except InputError as error:
            if error.field != "ssd":
                raise
            DataWarning.warn(f"{within(f'participant {who}', error, 'data')}; left out")
    if not found:
        raise InputError("no participant has stop trials and enough go responses", "data")
    return found


def _fit(each: dict[str, Likelihood]) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Return the parameters of a group, or of people one by one, and everyone's estimates."""
    import pandas as pd

    from bgmodel.fitting.fit import fit_likelihood
    from bgmodel.fitting.hierarchy.fit import FEWEST_PEOPLE, fit_group

    if len(each) >= FEWEST_PEOPLE:
        group = fit_group(each)
        table, own = group.summary().reset_index(), group.to_dataframe()
        own = own.rename(columns={"median": "value"})
    else:
        tables = {who: fit_likelihood(likelihood).parameters() for who, likelihood in each.items()}
        table = own = pd.concat(tables, names=["participant"]).reset_index(level="participant")
    wide = own.pivot(index="participant", columns="parameter", values="value")
    return pd.DataFrame(table), wide.rename_axis("participant_id")
