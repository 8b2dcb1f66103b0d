"""The front door to fits: trials of one person or of a group, and a model."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from inspect import signature
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, overload

from bgmodel.fitting.fit import Fit, fit_likelihood
from bgmodel.fitting.hierarchy.chains import MOST
from bgmodel.fitting.hierarchy.fit import HIERARCHY_SEED, GroupFit, fit_group
from bgmodel.fitting.hierarchy.group import ALIKE
from bgmodel.fitting.settings import (
    FitSettings,
    need_fit,
    seconds_of,
    settings_of,
)
from bgmodel.support.checks import check_flag, path_of, whole
from bgmodel.trials.reading import OURS, Columns
from circuits.errors import InputError

if TYPE_CHECKING:
    import pandas as pd

    from bgmodel.fitting.likelihood import TrialModel
    from bgmodel.trials.record import Trials
    from circuits.circuit import Circuit

READINGS = ("step_ms", "forced", "runs")
"""Options that need evidence."""
CHAINS = ("most_draws", "chains_seed", "workers")
"""Options that need a hierarchy."""
NOT_KNOWN = (
    "strength", "pooled", "rt_window", "vary", "formula", "mechanism", "noise_nats", "trials",
    "folder", "hierarchical",
)  # fmt: skip
"""Options without effect if the evidence is known."""


@overload
def fit(
    data: str | Path | pd.DataFrame | Trials,
    model: str | Path | Circuit | TrialModel = ...,
    *,
    hierarchical: Literal[True],
    **options: Any,
) -> GroupFit: ...
@overload
def fit(
    data: str | Path | pd.DataFrame | Trials,
    model: str | Path | Circuit | TrialModel = ...,
    *,
    hierarchical: Literal[False] = False,
    **options: Any,
) -> Fit: ...
def fit(  # type: ignore[misc]  # the overloads spell out only what changes the result
    data: str | Path | pd.DataFrame | Trials,
    model: str | Path | Circuit | TrialModel = "macaque",
    *,
    strength: str | None = None,
    participant: str | None = None,
    columns: Columns = OURS,
    pooled: bool = False,
    hierarchical: bool = False,
    rt_window: tuple[float, float] | None = None,
    mechanism: str = FitSettings.mechanism,
    free: Sequence[str] | str = (),
    fix: Mapping[str, float] | None = None,
    vary: Mapping[str, str] | None = None,
    formula: Sequence[str] | str = (),
    draws: bool = False,
    engine: str = FitSettings.engine,
    noise_nats: float = FitSettings.noise_nats,
    trials: int = FitSettings.trials,
    seed: int = FitSettings.seed,
    folder: str | Path | None = None,
    evidence: str | Path | pd.DataFrame | None = None,
    step_ms: float | None = None,
    forced: bool = False,
    runs: int | None = None,
    most_draws: int = MOST,
    chains_seed: int = HIERARCHY_SEED,
    workers: int = 1,
) -> Fit | GroupFit:
    """Fit a model to trials of one person, or of a group in a hierarchy, as ``bgmodel fit`` does.

    Parameters
    ----------
    data : str, path, DataFrame or Trials
        Name of a shipped set, a .csv, .tsv or .parquet file, or a table with the columns
        participant_id, rt (s), response, and those of conditions; or what ``read_trials`` returned.
    model : str, path, Circuit or TrialModel
        constant_gap, falling_gap, hyperbolic_gap, weibull_gap (two alternatives), msprt, race, lca
        (two or more), a circuit with a channel for each alternative: its name, .toml file or
        Circuit; or your own model of trials (``fitting.likelihood.TrialModel``).
    strength : str, optional
        Column of the signed strength of the evidence: positive favours response 1.
    participant : str, optional
        The participant to fit, if there are several.
    columns : Columns
        Names, units and codes of the columns of the table, if they are not ours.
    pooled : bool
        Whether to fit several participants as if they were one.
    hierarchical : bool
        Whether to fit all participants together, each with parameters from a distribution of the
        group, which is fitted too (partial pooling).
    rt_window : (float, float), optional
        Earliest and latest response time to fit, s.
    mechanism : str
        What changes the criterion of a circuit; a name in ``fitting.mechanisms.MECHANISMS``.
    free : sequence of str, or str
        Parameters to fit; by default all except start, start_spread, drift_sd and floor. With a
        plus, in addition: ``"+start"``.
    fix : mapping from names to values, optional
        Fixed parameters: ``{"lapse": 0.02}``.
    vary : mapping from names to columns, optional
        Parameters that differ between conditions: ``{"sensitivity": "conflict"}``.
    formula : str, or sequence of str
        Parameters that are linear in conditions: ``"bound ~ instruction * side"``. In a hierarchy
        also in what differs between people: ``"bound ~ group"``, which moves every number of the
        parameter.
    draws : bool
        Whether to sample from the posterior as well; a hierarchical fit always does.
    engine, noise_nats, trials, seed :
        Options of the simulated trials of a circuit; as in ``FitSettings``.
    folder : path, optional
        Folder that keeps simulated trials for other fits.
    evidence : path or DataFrame, optional
        The readings of each trial, as for ``known.table.read_known``: the model then answers for
        each single trial. Models are msprt, leaky_sum, run or a circuit.
    step_ms : float, optional
        Time between readings, ms, if the evidence has steps instead of times.
    forced : bool
        Whether the last reading of a trial forces a response.
    runs : int, optional
        Simulated runs of each trial by a circuit, if there is evidence; by default 8 to 32.
    most_draws, chains_seed, workers :
        Of a hierarchical fit: largest number of draws of each of four chains, their seed, and the
        number of processes, on which the result does not depend.

    Returns
    -------
    Fit, or GroupFit if hierarchical
        With ``summary()``, ``plot()``, ``cells()`` and ``to_dataframe()``.

    Raises
    ------
    ValueError
        For a table that cannot be read or fitted, for several participants unless they are pooled
        or in a hierarchy, and for options without effect.

    Warns
    -----
    UserWarning
        As for ``fit_likelihood`` and ``fit_group``, and for tables that may mislead.
    """
    given = locals()
    need_fit()
    check_flag("draws", draws)
    check_flag("hierarchical", hierarchical)
    check_flag("forced", forced)
    for name, value in (("most_draws", most_draws), ("workers", workers)):
        whole(name, value, 1)
    whole("chains_seed", chains_seed, 0)
    if evidence is not None:
        _check_unused(given, (*NOT_KNOWN, *CHAINS), "with evidence")
        return _fit_known(given)
    _check_unused(given, READINGS, "without evidence, the readings of each trial")
    if hierarchical:
        _check_unused(given, ("draws", "pooled"), "in a hierarchy")
    else:
        _check_unused(given, CHAINS, "without a hierarchy")
    asked = settings_of(
        strength=strength, participant=participant, columns=columns, pooled=pooled,
        hierarchical=hierarchical,
        rt_window=rt_window, mechanism=mechanism, engine=engine, free=free, fix=fix, vary=vary,
        formula=formula, noise_nats=noise_nats, trials=trials, seed=seed,
    )  # fmt: skip
    # Before the table is read: the column of an unknown parameter may be missing too.
    first = asked.model(model)
    asked.check_parameters({"model": first})
    found = asked.read(data)
    asked.check_kind(found, [first])
    asked, between = asked.split(found)
    people = asked.people(found)
    if len(people) > 1 and not hierarchical:
        names = ", ".join(who for who, _ in people)
        raise InputError(
            f"a fit is of one person, and these trials are of {names}: give participant=NAME, "
            "hierarchical=True to fit them as a group, or pooled=True to fit them as if they were "
            "one",
            "participant",
        )
    designs = {who: asked.design(some) for who, some in people}
    kept = None if folder is None else path_of(folder, "folder")
    chosen = asked.model(
        model, seconds=seconds_of(designs.values()), folder=kept, alternatives=found.alternatives
    )
    if hierarchical:
        likelihoods = asked.likelihoods(designs, chosen)
        predictors = asked.predictors(between, found, likelihoods) if between else ALIKE
        return fit_group(
            likelihoods, predictors=predictors, seed=chains_seed, workers=workers,
            most_draws=most_draws,
        )  # fmt: skip
    return fit_likelihood(asked.likelihood(designs[people[0][0]], chosen), draws=draws)


def _fit_known(given: Mapping[str, Any]) -> Fit:
    """Return the fit to trials whose evidence is known."""
    from bgmodel.fitting.known.settings import fit_evidence
    from bgmodel.fitting.known.table import read_known
    from bgmodel.fitting.likelihood import TrialModel

    model = given["model"]
    if isinstance(model, TrialModel):
        raise InputError("a model of trials takes no evidence yet: leave it out", "evidence")
    names = ("step_ms", "forced", "participant", "columns")
    known = read_known(given["data"], given["evidence"], **{name: given[name] for name in names})
    asked = settings_of(**{name: given[name] for name in ("free", "fix", "engine", "seed")})
    return fit_evidence(known, model, asked, runs=given["runs"], draws=given["draws"])


def _check_unused(given: Mapping[str, object], names: Sequence[str], reason: str) -> None:
    """Raise ValueError for an option that was given though it has no effect."""
    usual = {each.name: each.default for each in signature(fit).parameters.values()}
    for name in names:
        if repr(given[name]) != repr(usual[name]):
            raise InputError(f"{name} has no effect {reason}: leave it out", name)
