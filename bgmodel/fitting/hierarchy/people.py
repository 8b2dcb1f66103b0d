"""The front door to hierarchical fits: a table of many people's trials, and a model."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

from bgmodel.fitting.hierarchy.chains import MOST
from bgmodel.fitting.hierarchy.fit import HIERARCHY_SEED, GroupFit, fit_group
from bgmodel.fitting.settings import need_fit, seconds_of, settings_of
from bgmodel.support.checks import path_of, whole

if TYPE_CHECKING:
    import pandas as pd

    from bgmodel.fitting.likelihood import TrialModel
    from circuits.circuit import Circuit


def fit_people(
    data: str | Path | pd.DataFrame,
    model: str | Path | Circuit | TrialModel = "macaque",
    *,
    most_draws: int = MOST,
    chains_seed: int = HIERARCHY_SEED,
    workers: int = 1,
    folder: str | Path | None = None,
    **options: Any,
) -> GroupFit:
    """Fit a model to a group of people, with partial pooling of every parameter.

    Parameters
    ----------
    data : str, path or DataFrame
        As for ``bgmodel.fit``, with a column of participants.
    model : str, path, Circuit or TrialModel
        As for ``bgmodel.fit``.
    most_draws : int
        Largest number of draws of each of four chains.
    chains_seed : int
        Seed of the chains.
    workers : int
        Number of processes; the result does not depend on it.
    folder : path, optional
        Folder that keeps simulated trials for other fits.
    **options
        Further arguments of ``bgmodel.fit`` on columns of the table, on parameters and on simulated
        trials: ``strength="coherence"``, ``vary={"bound": "instruction"}``.

    Returns
    -------
    GroupFit
        With ``summary()``, ``difference()``, ``to_dataframe()``, ``plot()`` and ``to_netcdf()``.

    Raises
    ------
    ValueError
        As for ``bgmodel.fit`` and ``hierarchy.fit.fit_group``.
    """
    need_fit()
    whole("most_draws", most_draws, 1)
    whole("workers", workers, 1)
    whole("chains_seed", chains_seed, 0)
    asked = settings_of(**options)
    asked.check_parameters({"model": asked.model(model)})
    designs = {who: asked.design(some) for who, some in asked.people(asked.read(data))}
    kept = None if folder is None else path_of(folder, "folder")
    chosen = asked.model(model, seconds=seconds_of(designs.values()), folder=kept)
    return fit_group(
        asked.likelihoods(designs, chosen), seed=chains_seed, workers=workers, most_draws=most_draws
    )
