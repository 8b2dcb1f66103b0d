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

    from bgmodel.fitting.known.fit import KnownFit
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
    command.check_idle(USED, "--evidence")
    folder = command.folder or Path("fits") / Path(command.data).stem
    paths = [folder / name for name in TABLES]
    for path in paths:
        files.check_new(path, force=command.output.force and files.is_result(path))
    files.check_writable(folder)
    people = _people(command)
    made = {who: _models(command, trials) for who, trials in people.items()}
    texts: list[str] = []
    parts: list[list[pd.DataFrame]] = [[] for _ in TABLES]
    for who, trials in people.items():
        command.output.note(trials.summary())
        fits = _fitted(command, made[who], trials)
        text, tables = _report(who, fits)
        texts.append(text)
        for part, table in zip(parts, tables, strict=True):
            part.append(table)
        _draw(fits, folder / f"known_{safe(who)}.png")
    tables = _written(command, parts, paths)
    command.output.show("\n\n".join(texts), tables[0], parameters=tables[1].to_dict("records"))
    command.output.note(f"-> {folder}: {', '.join(TABLES)}, a figure for each participant")


def _people(command: Any) -> dict[str, KnownTrials]:
    """Return the trials of each participant."""
    from bgmodel.fitting.known.table import people_of, read_known

    given = {name: getattr(command, name) for name in READ}
    given |= {"step_ms": command.step_ms, "forced": command.forced}
    names = [command.participant] if command.participant else None
    found = {}
    for who in names or people_of(command.data, command.columns):
        own = {**given, "participant": who}
        found[who or "all"] = read_known(command.data, command.evidence, **own)
    return found


def _models(command: Any, trials: KnownTrials) -> dict[str, Any]:
    """Return the models to fit; ValueError for unknown models and parameters."""
    from bgmodel.fitting.known.settings import MODELS, check_known, known_model

    made = {
        each: known_model(
            each, trials.alternatives, engine=command.engine, runs=command.runs, seed=command.seed
        )
        for each in command.models or MODELS
    }
    check_known(made, trials, command.free, command.fixed)
    return made


def _fitted(command: Any, models: dict[str, Any], trials: KnownTrials) -> dict[str, KnownFit]:
    """Return the fit of each model."""
    from bgmodel.fitting.known.settings import fit_one

    found = {}
    for name, model in models.items():
        say(f"fitting {name}")
        found[name] = fit_one(model, trials, command.free, command.fixed)
    return found


def _report(who: str, fits: dict[str, KnownFit]) -> tuple[str, list[pd.DataFrame]]:
    """Return the text on one participant, and the tables of all models."""
    import pandas as pd

    from bgmodel.fitting.known.comparison import compared, verdict

    table = compared(fits)
    parameters = pd.concat([f.parameters().assign(model=name) for name, f in fits.items()])
    hazards = pd.concat([f.hazards().assign(model=name) for name, f in fits.items()])
    kernels = pd.concat([f.kernels().assign(model=name) for name, f in fits.items()])
    text = (
        f"{who}\n{table.round(3).to_string(index=False)}\npreferred: {verdict(table)}\n\n"
        f"{parameters.round(4).to_string(index=False)}"
    )
    every = (table, parameters, hazards, kernels)
    return text, [each.assign(participant_id=who) for each in every]


def _written(
    command: Any, parts: list[list[pd.DataFrame]], paths: list[Path]
) -> list[pd.DataFrame]:
    """Write the tables of all participants, with the options behind them."""
    import pandas as pd

    asked = {name: recorded(getattr(command, name)) for name in USED if name not in UNRECORDED}
    asked |= {"folder": None, "bgmodel": __version__}
    for name in ("data", "evidence"):
        file = Path(getattr(command, name))
        asked[f"{name}_sha256"] = files.checksum(file) if file.is_file() else None
    tables = [pd.concat(part, ignore_index=True) for part in parts]
    for table, path in zip(tables, paths, strict=True):
        files.write_table(table, path, seed=command.seed, **asked)
    return tables


def _draw(fits: dict[str, KnownFit], path: Path) -> None:
    """Draw all models, the best first."""
    from bgmodel.fitting.known.comparison import compared
    from bgmodel.fitting.known.drawing import draw_known

    order = compared(fits)["model"].tolist()
    hazards, kernels = ({n: getattr(fits[n], w)() for n in order} for w in ("hazards", "kernels"))
    save_figure(draw_known(hazards, kernels, fits[order[0]].likelihood.trials.title), path)
