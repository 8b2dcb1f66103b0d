"""The fit of a model to the choices and times of one person."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from bgmodel.fitting.settings import (
    FitSettings,
    need_fit,
    seconds_of,
    settings_of,
)
from bgmodel.support.checks import check_flag, path_of
from circuits.errors import InputError

if TYPE_CHECKING:
    import pandas as pd

    from bgmodel.fitting.fit import Fit
    from bgmodel.fitting.likelihood import TrialModel
    from circuits.circuit import Circuit


def fit(
    data: str | Path | pd.DataFrame,
    model: str | Path | Circuit | TrialModel = "macaque",
    *,
    strength: str | None = None,
    participant: str | None = None,
    pooled: bool = False,
    upper: str | None = None,
    deadline_s: float | None = None,
    rt: str | None = None,
    response: str | None = None,
    participant_column: str | None = None,
    rt_unit: str = FitSettings.rt_unit,
    alternatives: int | None = None,
    stimulus: str | None = None,
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
) -> Fit:
    """Fit a model to one person's choices and response times, as ``bgmodel fit`` does.

    Parameters
    ----------
    data : str, path or DataFrame
        Name of an included data set, a .csv, .tsv or .parquet file, or a table with the columns
        participant_id, rt (s), response, and those of conditions.
    model : str, path, Circuit or TrialModel
        constant_gap, falling_gap, hyperbolic_gap, weibull_gap (two alternatives), msprt, race, lca
        (two or more), a circuit with a channel for each alternative: its name, .toml file or
        Circuit; or your own model of trials (``fitting.likelihood.TrialModel``).
    strength : str, optional
        Column of the signed strength of the evidence: positive favours response 1.
    participant : str, optional
        The participant to fit, if there are several.
    pooled : bool
        Whether to fit several participants as if they were one.
    upper : str, optional
        Name of the response that counts as 1, if responses are not 1 and 0.
    deadline_s : float, optional
        Time at which a trial without a response ended, s.
    rt, response, participant_column : str, optional
        Names of these columns, if they are not rt, response and participant_id.
    rt_unit : str
        Unit of response times in the table: s or ms.
    alternatives, stimulus :
        Number of alternatives, and column of the correct one; as for ``read_trials``.
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
        Parameters that are linear in conditions: ``"bound ~ instruction * side"``.
    draws : bool
        Whether to sample from the posterior as well.
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

    Returns
    -------
    Fit
        With ``summary()``, ``parameters()``, ``cells()`` and ``plot()``.

    Raises
    ------
    ValueError
        For a table that cannot be read or fitted, and for several participants unless ``pooled``.

    Warns
    -----
    UserWarning
        As for ``fit_likelihood``, and for tables that may mislead.
    """
    from bgmodel.fitting.fit import fit_likelihood

    if evidence is not None:
        _check_alone(locals())
        from bgmodel.fitting.likelihood import TrialModel

        if isinstance(model, TrialModel):
            raise InputError("a model of trials takes no evidence yet: leave it out", "evidence")
        from bgmodel.fitting.known.settings import fit_evidence
        from bgmodel.fitting.known.table import read_known

        check_flag("forced", forced)
        check_flag("draws", draws)
        known = read_known(
            data, evidence, step_ms=step_ms, forced=forced, participant=participant, upper=upper,
            rt=rt, response=response, participant_column=participant_column, rt_unit=rt_unit,
        )  # fmt: skip
        asked = settings_of(free=free, fix=fix, engine=engine, seed=seed)
        return fit_evidence(known, model, asked, runs=runs, draws=draws)
    unused = (("step_ms", step_ms, None), ("forced", forced, False), ("runs", runs, None))
    for option, value, default in unused:
        if value is not default:
            raise InputError(f"{option} needs evidence, the readings of each trial", option)
    need_fit()
    asked = settings_of(
        strength=strength, participant=participant, pooled=pooled, upper=upper,
        deadline_s=deadline_s,
        rt=rt, response=response, participant_column=participant_column, rt_unit=rt_unit,
        alternatives=alternatives, stimulus=stimulus, rt_window=rt_window, mechanism=mechanism,
        engine=engine, free=free, fix=fix, vary=vary,
        formula=formula, noise_nats=noise_nats, trials=trials, seed=seed,
    )  # fmt: skip
    check_flag("draws", draws)
    # Before the table is read: the column of an unknown parameter may be missing too.
    asked.check_parameters({"model": asked.model(model)})
    choices = asked.read(data)
    number = choices.alternatives
    people = asked.people(choices)
    if len(people) > 1:
        names = ", ".join(who for who, _ in people)
        raise InputError(
            f"a fit is of one person, and these trials are of {names}: give participant=NAME, or "
            "pooled=True to fit them as if they were one; fit_people fits a group",
            "participant",
        )
    design = asked.design(people[0][1])
    kept = None if folder is None else path_of(folder, "folder")
    chosen = asked.model(model, seconds=seconds_of([design]), folder=kept, alternatives=number)
    return fit_likelihood(asked.likelihood(design, chosen), draws=draws)


NOT_KNOWN = {
    "strength": None, "pooled": False, "deadline_s": None, "alternatives": None, "stimulus": None,
    "rt_window": None, "vary": None,
    "formula": (),
    "mechanism": FitSettings.mechanism, "noise_nats": FitSettings.noise_nats,
    "trials": FitSettings.trials, "folder": None,
}  # fmt: skip
"""Options of ``fit`` without effect if the evidence is known, and their defaults."""


def _check_alone(given: Mapping[str, object]) -> None:
    """Raise ValueError for an option that has no effect if the evidence is known."""
    for name, default in NOT_KNOWN.items():
        if given[name] != default:
            raise InputError(f"{name} has no effect with evidence: leave it out", name)
