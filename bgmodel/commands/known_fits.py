"""Fits on known evidence at the terminal: `bgmodel fit trials.csv --evidence evidence.csv`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from bgmodel.commands.output import UNRECORDED, recorded, save_figure, say
from bgmodel.fitting.pieces import safe
from bgmodel.support import files
from bgmodel.version import __version__

if TYPE_CHECKING:
    import pandas as pd

    from bgmodel.fitting.known.likelihood import OnTrials
    from bgmodel.fitting.known.trials import KnownTrials

TABLES = ("known_models.csv", "known_parameters.csv", "known_hazards.csv", "known_kernels.csv")
"""Comparison of models, their parameters, hazards per reading, and kernels."""
READ = ("participant", "columns")
USED = (
    "data", "folder", "models", "evidence", "step_ms", "forced", "runs", *READ, "free", "fix",
    "engine", *UNRECORDED,
)  # fmt: skip
"""Options that have an effect on a fit on known evidence, or on its files."""


def fit_known_evidence(command: Any) -> None:
    """Fit each model to each participant, compare them, print both, and write tables and figures.

    Parameters
    ----------
    command : FitRun
        The command, which imports this module.
    """
    import pandas as pd

    command.check_idle(USED, "--evidence")
    command.check()
    folder = command.folder or Path("fits") / Path(command.data).stem
    paths = [folder / name for name in TABLES]
    for path in paths:
        files.check_new(path, force=command.output.force and files.is_result(path))
    files.check_writable(folder)
    people = _people(command)
    made = {who: _models(command, trials) for who, trials in people.items()}
    found = []
    for who, models in made.items():
        command.output.note(people[who].summary())
        found.append(_fitted(command, who, models, folder))
    tables = [pd.concat(part, ignore_index=True) for part in zip(*found, strict=True)]
    asked = _asked(command)
    for table, path in zip(tables, paths, strict=True):
        files.write_table(table, path, seed=command.seed, **asked)
    text = "\n\n".join(table.round(4).to_string(index=False) for table in tables[:2])
    command.output.show(text, tables[0], parameters=tables[1].to_dict("records"))
    command.output.note(f"-> {folder}: {', '.join(TABLES)}, a figure for each participant")


def _people(command: Any) -> dict[str, KnownTrials]:
    """Return the trials of each participant."""
    from bgmodel.fitting.known.table import people_of, read_known

    given = {name: getattr(command, name) for name in (*READ, "step_ms", "forced")}
    names = [command.participant] if command.participant else None
    found = {}
    for who in names or people_of(command.data, command.columns):
        own = {**given, "participant": who}
        found[who or "all"] = read_known(command.data, command.evidence, **own)
    return found


def _models(command: Any, trials: KnownTrials) -> dict[str, OnTrials]:
    """Return the models to fit; ValueError for unknown models and parameters."""
    from bgmodel.fitting.known.likelihood import OnTrials
    from bgmodel.fitting.known.settings import MODELS, known_model

    made = {
        each: OnTrials(known_model(each, trials.alternatives, command, command.runs), trials)
        for each in command.models or MODELS
    }
    command.check_parameters(made)
    return made


def _fitted(
    command: Any, who: str, models: dict[str, OnTrials], folder: Path
) -> list[pd.DataFrame]:
    """Fit and draw the models of one participant; return their tables, the best model first."""
    import pandas as pd

    from bgmodel.fitting.fit import fit_likelihood
    from bgmodel.fitting.known.drawing import draw_known
    from bgmodel.fitting.known.hazards import hazards
    from bgmodel.fitting.known.kernels import kernels
    from bgmodel.fitting.model_comparison import crossvalidated

    fits = {}
    for name, model in models.items():
        say(f"fitting {name}")
        fits[name] = fit_likelihood(command.likelihood(model.trials.design, model))
    peaks = {name: (each.optimum.likelihood, each.optimum.vector) for name, each in fits.items()}
    order = crossvalidated({name: {who: peak} for name, peak in peaks.items()}, tell=say).table
    save_figure(
        draw_known({str(name): fits[name].optimum for name in order.index}),
        folder / f"known_{safe(who)}.png",
    )
    of_each = [{name: fit.parameters() for name, fit in fits.items()}]
    of_each += [{name: of(*peak) for name, peak in peaks.items()} for of in (hazards, kernels)]
    tables = [pd.concat(each, names=["model"]).reset_index("model") for each in of_each]
    return [each.assign(participant_id=who) for each in (order.reset_index(), *tables)]


def _asked(command: Any) -> dict[str, Any]:
    """Return the options behind the tables."""
    asked = {name: recorded(getattr(command, name)) for name in USED if name not in UNRECORDED}
    asked |= {"folder": None, "bgmodel": __version__}
    for name in ("data", "evidence"):
        file = Path(getattr(command, name))
        asked[f"{name}_sha256"] = files.checksum(file) if file.is_file() else None
    return asked
