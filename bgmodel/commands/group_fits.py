"""Hierarchical fits at the terminal: `bgmodel fit --people hierarchical`."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from bgmodel.commands.fitted import write_comparison
from bgmodel.commands.output import plain, recorded, save_figure, say, stages
from bgmodel.support import files
from circuits.errors import InputError, collected

if TYPE_CHECKING:
    import pandas as pd

    from bgmodel.fits import Question
    from bgmodel.fitting.hierarchy.fit import GroupFit
    from bgmodel.fitting.hierarchy.group import Predictors
    from bgmodel.fitting.likelihood import Likelihood

GROUP, PEOPLE, CELLS = "group.csv", "people.csv", "people_cells.csv"
EFFECTS, CORRELATIONS = "group_effects.csv", "group_correlations.csv"
"""Tables of a hierarchical fit: parameters of the group and of each participant, data and model of
each participant, effects of predictors between people, and correlations."""


def fit_hierarchically(
    command: Any,
    folder: Path,
    asked: dict[str, Any],
    one: Question,
) -> None:
    """Fit each model to all participants, print the group's parameters and write tables and draws.

    Parameters
    ----------
    command : FitRun
        The command.
    folder : path
        Folder for results.
    asked : dict
        Options, for the provenance.
    one : Question
        Trials and models.
    """
    import pandas as pd

    if command.draws:
        raise InputError(
            "--draws has no effect with --people hierarchical, which always draws", "draws"
        )
    for name in (GROUP, PEOPLE, CELLS, EFFECTS, CORRELATIONS):
        path = folder / name
        files.check_new(path, force=command.output.force and files.is_result(path))
    files.check_writable(folder)
    models = {name: one.likelihoods(name) for name in one.versions}
    key = {**asked, "checksum": one.trials.checksum}
    fits = {
        name: _fit(command, folder, name, likelihoods, one.predictors(likelihoods), key)
        for name, likelihoods in models.items()
    }
    group = _table({name: fit.summary().reset_index() for name, fit in fits.items()})
    people = _table({name: fit.to_dataframe() for name, fit in fits.items()})
    cells = _table({name: fit.cells() for name, fit in fits.items()})
    between = _table({name: fit.effects().reset_index() for name, fit in fits.items()})
    related = _table({name: fit.correlations().reset_index() for name, fit in fits.items()})
    tables = [(group, GROUP), (people, PEOPLE), (cells, CELLS)]
    tables += [(each, name) for each, name in ((between, EFFECTS), (related, CORRELATIONS))
               if not each.empty]  # fmt: skip
    written = [name for _, name in tables]
    for table, name in tables:
        files.write_table(table, folder / name, seed=command.seed, **asked)
    if command.compare:
        from bgmodel.fitting.model_comparison import compare_fits

        comparison = compare_fits(fits)
        write_comparison(comparison, folder, command.seed, asked)
        command.output.note("\n" + comparison.summary())
    with pd.option_context("display.width", 160):
        effects = "" if between.empty else "\n\n" + between.round(4).to_string(index=False)
        notes = "".join(f"\n\n{name}, {fit.notes()}" for name, fit in fits.items() if fit.notes())
        shown = "\n" + group.round(4).to_string(index=False) + effects + notes
        more = {"effects": between, "correlations": related}
        records = {name: table.to_dict("records") for name, table in more.items()}
        command.output.show(shown, group, **records)
    command.output.note(
        f"-> {folder}: {', '.join(written)}; for each model figures of its parameters and of "
        "data and model, and the draws (.nc, for ArviZ)"
    )


def _fit(
    command: Any,
    folder: Path,
    name: str,
    likelihoods: Mapping[str, Likelihood],
    predictors: Predictors,
    asked: dict[str, Any],
) -> GroupFit:
    """Return one model's fit, after writing its draws and its figures."""
    from bgmodel.fitting.hierarchy.chains import chains_entry
    from bgmodel.fitting.hierarchy.fit import fit_group
    from bgmodel.fitting.likelihood import identity_of

    first = next(iter(likelihoods.values()))
    key = {
        **asked,
        "model": recorded(identity_of(first.model)),
        "people": list(likelihoods),
        "values": [each.start for each in first.freedom.parameters],
        "free": first.freedom.names,
        "priors": first.freedom.stated,
        "predictors": {
            name: values.tolist()
            for name, values in zip(predictors.names, predictors.columns, strict=True)
        },
    }
    stem = plain(name)
    kept = chains_entry(folder / "pieces", stem, key)
    with stages(name) as tell, collected() as cautions:
        fit = fit_group(
            likelihoods, predictors=predictors, workers=command.workers, kept=kept, tell=tell,
            correlated=command.correlated,
        )  # fmt: skip
    for caution in cautions:
        say(f"{name}: {caution}")
    fit.to_netcdf(folder / f"{stem}.nc")
    save_figure(fit.plot(), folder / f"{stem}.png")
    try:
        save_figure(fit.plot_cells(), folder / f"{stem} cells.png")
    except InputError as error:
        command.output.note(f"{name}: no figure of data and model, {error}")
    return fit


def _table(parts: Mapping[str, pd.DataFrame]) -> pd.DataFrame:
    """Return the tables of all models as one, with a column of their names."""
    import pandas as pd

    return pd.concat(
        [part.assign(model=name) for name, part in parts.items()], ignore_index=True
    ).pipe(lambda table: table[["model", *table.columns.drop("model")]])
