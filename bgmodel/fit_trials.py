"""The front door of fits: trials of any kind, of one person or of a group, and models of them."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext, suppress
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, overload

import numpy as np

from bgmodel.fitting.fit_results import (
    COMPARISON,
    EACH,
    GROUP,
    FitFolder,
    Fits,
    GroupFits,
    fit_entry,
    report,
    settings_shared,
    stem,
)
from bgmodel.fitting.hierarchy.chains import MOST, chains_entry
from bgmodel.fitting.hierarchy.group import ALIKE, Predictors
from bgmodel.fitting.hierarchy.group_fit import HIERARCHY_SEED, GroupFit, fit_group
from bgmodel.fitting.likelihood import AnyModel, Likelihood, TrialModel, identity_of
from bgmodel.fitting.model_comparison import compare_fits, crossvalidated
from bgmodel.fitting.person_fit import Fit, fit_likelihood
from bgmodel.fitting.settings import (
    FitSettings,
    People,
    need_fit,
    seconds_of,
    settings_of,
    shared_ranges,
)
from bgmodel.support.checks import check_unused, path_of, whole
from bgmodel.support.files import checksum
from bgmodel.support.seeds import stream
from bgmodel.trials.columns import Someone
from bgmodel.trials.reader import OURS, Columns
from bgmodel.trials.record import Trials, joined
from bgmodel.trials.timed_readings import Source
from circuits.circuit import Circuit
from circuits.errors import DataWarning, FitWarning, InputError, collected, require, within

if TYPE_CHECKING:
    import pandas as pd

    from bgmodel.fitting.design import Design
    from bgmodel.fitting.formulas import Formula

ModelName = str | Path | Circuit | TrialModel


@dataclass(frozen=True)
class TrialKind:
    """How trials of one kind are fitted."""

    # The model of a name or record; the folder keeps simulated trials.
    model: Callable[[Question, Any, Path | None], AnyModel]
    # The likelihood of one person's trials under a model.
    likelihood: Callable[[FitSettings, Question, str, Any], Likelihood]
    defaults: tuple[str, ...]  # models that the command compares; the last is that of ``fit``
    unused: tuple[str, ...]  # settings without effect
    # Estimates without a model, one row per person.
    estimates: Callable[[dict[str, Trials]], pd.DataFrame] | None = None


@dataclass(frozen=True)
class Question:
    """Trials that have been read, and the models that are to be fitted to them."""

    asked: FitSettings  # without formulas of what differs between people
    trials: Trials
    data: tuple[str, str] = ("", "")  # name and hash of the table
    between: list[Formula] = field(default_factory=list)  # of what differs between people
    # Models by name, each with its settings.
    versions: dict[str, tuple[FitSettings, AnyModel, TrialKind]] = field(default_factory=dict)
    # Parameters that are asked for and that a model does not have, as sentences.
    lacking: list[str] = field(default_factory=list)

    @cached_property
    def people(self) -> dict[str, Trials]:
        """Trials of each person, or of all pooled."""
        return self.asked.by_person(self.trials)

    @cached_property
    def designs(self) -> dict[str, Design]:
        """Each person's trials by strength and conditions.

        Warns if a formula compares the levels of some people with another level than of others.
        """
        for formula in () if self.asked.hierarchical else self.asked.formulas.values():
            for column in self.trials.conditions.columns.intersection(formula.columns):
                self._warn_of_levels(formula.parameter, column)
        return {who: self.asked.design(some) for who, some in self.people.items()}

    def _warn_of_levels(self, parameter: str, column: str) -> None:
        import pandas as pd

        values = self.trials.conditions[column]
        if pd.to_numeric(values, errors="coerce").notna().all():
            return
        first = {who: min(some.conditions[column]) for who, some in self.people.items()}
        lowest = min(first.values())
        if other := [who for who, level in first.items() if level != lowest]:
            DataWarning.warn(
                f"formula of {parameter}: {', '.join(other)} have no trials with {column} "
                f"{lowest}, so their coefficients are relative to another level than those of "
                "others: compare people only over levels that all of them have"
            )

    def likelihoods(self, name: str) -> dict[str, Likelihood]:
        """Return the likelihood of each person's trials under a model.

        People with too few stop trials are left out, with a warning.
        """
        asked, model, kind = self.versions[name]
        made: dict[str, Likelihood] = {}
        for who in self.people:
            try:
                made[who] = kind.likelihood(asked, self, who, model)
            except InputError as error:
                if error.field != "ssd" or len(self.people) == 1:
                    raise
                DataWarning.warn(f"{within(f'participant {who}', error, 'data')}; left out")
        if not made:
            raise InputError("no participant has stop trials and enough go responses", "data")
        return asked.with_priors(shared_ranges(made) if asked.hierarchical else made, model)

    def predictors(self, likelihoods: Mapping[str, Likelihood]) -> Predictors:
        """Return the predictors between people that shift parameters of a hierarchy."""
        if not self.between:
            return ALIKE
        return self.asked.predictors(self.between, self.trials, likelihoods)

    def add_constant(self) -> None:
        """Add the only model without each effect of conditions on its parameters."""
        ((name, (asked, model, kind)),) = self.versions.items()
        for effect in asked.effects:
            self.versions[f"{name}, same {effect}"] = asked.constant(effect), model, kind
        must = "needs at least two models, or one with vary or formula"
        require(len(self.versions) > 1, "compare", must, name)

    def circuits(self) -> dict[str, str]:
        """Return the hash of the circuit of each model that has one."""
        made = {
            name: identity_of(one).get("circuit") for name, (_, one, _) in self.versions.items()
        }
        return {name: each["sha256"] for name, each in made.items() if isinstance(each, dict)}

    def estimates(self) -> pd.DataFrame | None:
        """Return everyone's estimates without a model, if these trials have any."""
        estimator = KINDS[self.trials.kind].estimates
        return None if estimator is None else estimator(self.people)


def question(
    asked: FitSettings,
    data: str | Path | pd.DataFrame | Trials,
    models: Sequence[ModelName] | None = None,
    folder: Path | None = None,
    *,
    alone: bool = False,
) -> Question:
    """Read trials, and find the models that are asked for, by default those of the kind of trials.

    ``data`` and ``models`` are as for ``fit``; ``folder`` keeps simulated trials for other fits,
    and ``alone`` says that a single model is fitted. ValueError for trials that can't be read,
    unknown models and parameters, and settings without effect on these trials.
    """
    try:
        trials = asked.read(data)
    except InputError as error:
        choices = asked.evidence is None and getattr(data, "kind", "choices") == "choices"
        if choices and error.field in ("conditions", *asked.by):
            # The column of an unknown parameter may be missing too.
            of_choices: dict[str, AnyModel] = {}
            with suppress(InputError):  # for a model of another kind of trials
                of_choices = {str(name): asked.model(name) for name in models or ()}
            if of_choices:
                asked.check_parameters(of_choices)
        raise
    kind = KINDS[trials.kind]
    names = models or (MANY if trials.alternatives > 2 and kind is CHOICES else kind.defaults)
    names = names[-1:] if alone else names
    if all(isinstance(name, TrialModel) for name in names):
        kind = CHOICES
    _check_settings(asked, kind, trials)
    asked, between = asked.split(trials)
    one = Question(asked, trials, _origin(data, trials), between)
    for name in names:
        if isinstance(name, TrialModel):
            one.versions[getattr(name, "name", type(name).__name__)] = asked, name, CHOICES
        else:
            text = name.name if isinstance(name, Circuit) else str(name)
            one.versions[text] = asked, kind.model(one, name, folder), kind
    models_by_name = {name: model for name, (_, model, _) in one.versions.items()}
    one.lacking.extend(asked.check_parameters(models_by_name))
    if asked.compare and len(one.versions) == 1:
        one.add_constant()
    return one


def _origin(data: object, trials: Trials) -> tuple[str, str]:
    """Return the name of a table, and what its trials are known by: a hash, or a shipped set."""
    if not isinstance(data, str | Path):
        return trials.source, trials.checksum
    # Of the whole table: participants may be fitted one after the other.
    return str(data), checksum(data) if Path(data).is_file() else str(data)


def _check_settings(asked: FitSettings, kind: TrialKind, trials: Trials) -> None:
    """Raise ValueError for settings without effect on these trials."""
    check_unused(asked, kind.unused, f"on {trials.kind}")
    if not trials.timed:
        check_unused(asked, ["rt_window"], "on choices without times")
    if asked.hierarchical:
        check_unused(asked, ["draws"], "in a hierarchy, which always draws")
        must = "must be 2 in a hierarchical fit: fit each person separately"
        require(kind is not CHOICES or trials.alternatives == 2, "alternatives", must,
                trials.alternatives)  # fmt: skip
    pooled = asked.pooled and "pooled" in kind.unused
    require(not pooled, "people", f"must be another on {trials.kind}", asked.people)


def _model_of_choices(one: Question, name: Any, folder: Path | None) -> AnyModel:
    """Return a model of choices and times."""
    one.asked.model(name, alternatives=one.trials.alternatives)  # before trials are laid out
    return one.asked.model(
        name, seconds=seconds_of(one.designs.values()), folder=folder,
        alternatives=one.trials.alternatives,
    )  # fmt: skip


def _of_choices(asked: FitSettings, one: Question, who: str, model: AnyModel) -> Likelihood:
    """Return the likelihood of one person's choices and times."""
    strengths = [float(each.strength.max()) for each in one.designs.values()]
    return asked.likelihood(one.designs[who], model, max(strengths) if asked.hierarchical else None)


def _known_model(one: Question, name: Any, folder: Path | None) -> AnyModel:
    """Return a model of decisions on known evidence."""
    from bgmodel.fitting.known.known_circuit import FEWEST, KnownCircuit
    from bgmodel.fitting.known.known_likelihood import OnTrials
    from bgmodel.fitting.known.models import EXACT, GAIN
    from bgmodel.fitting.known.trials import known_trials
    from circuits.anatomy import CIRCUITS, checked_circuit
    from circuits.declaration.table_writer import is_path

    known = known_trials(next(iter(one.people.values())))
    if isinstance(name, str) and name in EXACT:
        assumed = one.trials.readings is not None and one.trials.readings.assumed
        asked = {*one.asked.named, *one.asked.fixed, *one.asked.varied, *one.asked.formulas}
        if name == "msprt" and known.alternatives == 2 and assumed and GAIN.name not in asked:
            DataWarning.warn(
                "value, the log likelihood ratio of each cue, must be given for msprt or its gain "
                "be freed (+gain), got neither: each cue counts 1 nat, and that size moves the "
                "estimates and the score"
            )
        return OnTrials(EXACT[name], known)
    if isinstance(name, str) and name not in CIRCUITS and not is_path(name):
        allowed = ", ".join((*EXACT, *CIRCUITS))
        raise InputError.of("models", f"must be of {allowed}, or .toml files", name)
    circuit, runs = checked_circuit(name, known.alternatives), one.asked.runs
    runs = None if runs is None else whole("runs", runs, FEWEST)
    return OnTrials(KnownCircuit(circuit, one.asked.engine, runs, one.asked.seed), known)


def _of_known(asked: FitSettings, one: Question, who: str, model: Any) -> Likelihood:
    """Return the likelihood of one person's trials with known evidence."""
    from bgmodel.fitting.known.trials import known_design, known_trials

    some = one.people[who]
    design = known_design(some, one.asked.by)
    return asked.likelihood(design, replace(model, trials=known_trials(some)))


def _cells(one: Question, name: Any, folder: Path | None) -> AnyModel:
    """Return a model of recorded cells and choices."""
    from bgmodel.fitting.cells.model import cells_model

    return cells_model(name, next(iter(one.people.values())))


def _of_cells(asked: FitSettings, one: Question, who: str, model: Any) -> Likelihood:
    """Return the likelihood of one person's choices and recorded cells."""
    from bgmodel.fitting.known.trials import known_design

    some = one.people[who]
    return asked.likelihood(known_design(some), replace(model, trials=some))


def _learner(one: Question, name: Any, folder: Path | None) -> AnyModel:
    """Return a model of people who learn values."""
    from bgmodel.learning.value_models import model_of

    return model_of(name)


def _of_learners(asked: FitSettings, one: Question, who: str, model: Any) -> Likelihood:
    """Return the likelihood of the trials of one person who learns values."""
    from bgmodel.learning.value_models import likelihood

    return likelihood(model, one.people[who], **asked.freedom(model))


def _stop_process(one: Question, name: Any, folder: Path | None) -> AnyModel:
    """Return a model of stop-signal trials, conditional on the go times."""
    from bgmodel.fitting.stop_race import stop_model

    return stop_model(name, one.asked.noise_nats)


def _of_stops(asked: FitSettings, one: Question, who: str, model: Any) -> Likelihood:
    """Return the likelihood of one person's stop trials; ValueError if they are too few."""
    from bgmodel.fitting.stop_race import likelihood

    return likelihood(model, one.people[who], **asked.freedom(model))


def _ssrt(people: dict[str, Trials]) -> pd.DataFrame:
    """Return everyone's stop-signal reaction time by integration, without a model of it."""
    from bgmodel.stopping.people import estimates_of
    from bgmodel.stopping.trials import StopTrials

    estimates = estimates_of({who: StopTrials.of(some) for who, some in people.items()})
    return estimates.rename(columns={"participant_id": "participant"})


ON_CHOICES = ("strength", "rt_window", "mechanism", "noise_nats", "trials")
"""Settings that have an effect on choices alone."""
CHOICES = TrialKind(_model_of_choices, _of_choices, ("constant_gap", "macaque"), ("runs",))
MANY = ("msprt", "macaque")
"""Models that the command compares by default with more than two alternatives."""
KNOWN = TrialKind(_known_model, _of_known, ("msprt", "leaky_sum", "run", "macaque"), ON_CHOICES)
CELLS = TrialKind(
    _cells, _of_cells, ("step", "exponential", "linear"),
    (*ON_CHOICES, "pooled", "vary", "formula", "engine", "seed", "runs"),
)  # fmt: skip
REWARDED = TrialKind(
    _learner, _of_learners, ("no learning", "q", "q, two rates"),
    (*ON_CHOICES, "pooled", "engine", "seed", "runs"),
)  # fmt: skip
STOPS = TrialKind(
    _stop_process, _of_stops, ("constant_gap", "macaque"),
    ("strength", "pooled", "rt_window", "mechanism", "trials", "engine", "seed", "runs"), _ssrt,
)  # fmt: skip
KINDS = {
    "choices": CHOICES,
    "spikes and choices": CELLS,
    "known evidence": KNOWN,
    "stop-signal trials": STOPS,
    "rewarded choices": REWARDED,
}
"""How each kind of trials (``trials.record.KINDS``) is fitted."""


@overload
def fit(
    data: str | Path | pd.DataFrame | Trials,
    model: ModelName | None = ...,
    *,
    people: Literal["pooled"] | None = ...,
    compare: Literal[False] = ...,
    **options: Any,
) -> Fit: ...
@overload
def fit(
    data: str | Path | pd.DataFrame | Trials,
    model: ModelName | None = ...,
    *,
    people: Literal["hierarchical", "correlated"],
    compare: Literal[False] = ...,
    **options: Any,
) -> GroupFit: ...
@overload
def fit(
    data: str | Path | pd.DataFrame | Trials,
    model: Sequence[ModelName] | ModelName | None = ...,
    *,
    people: Literal["each", "pooled"] | None = ...,
    **options: Any,
) -> Fits: ...
@overload
def fit(
    data: str | Path | pd.DataFrame | Trials,
    model: Sequence[ModelName] | ModelName | None = ...,
    *,
    people: People | None = ...,
    **options: Any,
) -> Fits | GroupFits: ...
def fit(  # type: ignore[misc]  # the overloads spell out only what changes the result
    data: str | Path | pd.DataFrame | Trials,
    model: ModelName | Sequence[ModelName] | None = None,
    *,
    people: People | None = None,
    compare: bool = False,
    strength: str | None = None,
    participant: Someone = None,
    columns: Columns = OURS,
    rt_window: tuple[float, float] | None = None,
    mechanism: str = FitSettings.mechanism,
    free: Sequence[str] | str = (),
    fix: Mapping[str, float] | None = None,
    vary: Mapping[str, str] | None = None,
    formula: Sequence[str] | str = (),
    prior: Mapping[str, tuple[float, float]] | None = None,
    draws: bool = False,
    engine: str = FitSettings.engine,
    noise_nats: float = FitSettings.noise_nats,
    trials: int = FitSettings.trials,
    seed: int = FitSettings.seed,
    folder: str | Path | None = None,
    evidence: Source | None = None,
    step_ms: float | None = None,
    forced: bool = False,
    runs: int | None = None,
    most_draws: int = MOST,
    chains_seed: int = HIERARCHY_SEED,
    workers: int = 1,
) -> Fit | GroupFit | Fits | GroupFits:
    """Fit models to trials of one person, of each of several, or of a group in a hierarchy.

    Parameters
    ----------
    data : str, path, DataFrame or Trials
        Name of a shipped set, a .csv, .tsv or .parquet file, or a table as for ``read_trials``; or
        what ``read_trials`` returned.
    model : str, path, Circuit or TrialModel, or a list of them, optional
        Of choices: constant_gap, falling_gap, hyperbolic_gap, weibull_gap (two alternatives),
        msprt, race, lca (two or more), or a circuit with a channel for each alternative: its name,
        .toml file or Circuit. With evidence: msprt, leaky_sum, run or a circuit. Of stop-signal
        trials: constant_gap or a circuit. Of rewarded choices: a learner
        (``learning.value_models.MODELS``). Of any: your own model of trials
        (``fitting.likelihood.TrialModel``). By default macaque, for rewarded choices "q, two
        rates"; an empty list is all models that the command compares by default.
    people : str, optional
        "each" fits each participant separately; "pooled" all as if they were one; "hierarchical"
        all together, each with parameters from a distribution of the group, which is fitted too
        (partial pooling); "correlated" as that, with parameters that may be correlated between
        people. By default there must be one participant.
    compare : bool
        Whether to compare the models by how well they predict trials that they were not fitted to,
        as ``compare_fits``; a single model with versions in which one parameter of ``vary`` or
        ``formula`` has one value, which is fitted, for all conditions.
    strength : str, optional
        Column of the signed strength of the evidence: positive favours response 1.
    participant : str, or sequence of str, optional
        The participants to fit, if there are others.
    columns : Columns
        Names, units and codes of the columns of the table, if they are not ours.
    rt_window : (float, float), optional
        Earliest and latest response time to fit, s.
    mechanism : str
        What changes the criterion of a circuit; a name in ``MECHANISMS`` of
        ``fitting.simulated.circuit_model``.
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
    prior : mapping from names to (low, high), optional
        Where 95 % of your belief about a number of the fit is, in its units: ``{"t0_s": (0.2,
        0.4)}``. In a hierarchy it is about the median person's. Without one a prior is uniform; in
        the fit of one person some models have weak ones.
    draws : bool
        Whether to sample from the posterior as well; a hierarchical fit always does.
    engine, noise_nats, trials, seed :
        Options of the simulated trials of a circuit; as in ``FitSettings``.
    folder : path, optional
        Folder that keeps simulated trials, and finished fits unless a model is your own: the same
        fits then resume there. Of several it gets the tables and figures of the command, too.
    evidence : path or DataFrame, optional
        The readings of each trial, as for ``read_trials``: the model then answers for each single
        trial.
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
    Fit, or GroupFit of a hierarchy
        Of a single model: with ``summary()``, ``plot()``, ``cells()`` and ``to_dataframe()``.
    Fits, or GroupFits of a hierarchy
        Of a list of models, of each person, or if models are compared: ``fits`` by model (and
        person), ``summary()``, ``tables()``, ``plot()`` and ``comparison``.

    Raises
    ------
    ValueError
        For a table that cannot be read or fitted, for several participants unless ``people`` says
        how they are fitted, and for options without effect.

    Warns
    -----
    UserWarning
        As for ``fit_likelihood`` and ``fit_group``, and for tables that may mislead.
    """
    need_fit()
    for name, value in (("most_draws", most_draws), ("workers", workers)):
        whole(name, value, 1)
    whole("chains_seed", chains_seed, 0)
    asked = settings_of(
        strength=strength, participant=participant, people="each" if people is None else people,
        columns=columns, rt_window=rt_window, mechanism=mechanism, engine=engine, free=free,
        fix=fix, vary=vary, formula=formula, prior=prior, noise_nats=noise_nats, trials=trials,
        seed=seed, evidence=evidence, step_ms=step_ms, forced=forced, runs=runs, draws=draws,
        compare=compare,
    )  # fmt: skip
    if not asked.hierarchical and (most_draws, chains_seed) != (MOST, HIERARCHY_SEED):
        reason = "has no effect without a hierarchy: leave it out"
        name = "most_draws" if most_draws != MOST else "chains_seed"
        raise InputError(f"{name} {reason}", name)
    kept = None if folder is None else path_of(folder, "folder")
    several = isinstance(model, (list, tuple))
    models: Any = list(model) if isinstance(model, (list, tuple)) else [model]
    models = None if model is None else models
    one = question(asked, data, models, kept and kept / SIMULATED, alone=not several)
    if people is None and len(one.people) > 1:
        raise InputError(
            f"a fit is of one person, and these trials are of {', '.join(one.people)}: give "
            'participant=NAME, or people="each", "hierarchical" (as a group) or "pooled" (as if '
            "they were one)",
            "participant",
        )
    several = several or compare or people == "each"
    every = fit_all(
        one, kept, workers=workers, most_draws=most_draws, chains_seed=chains_seed, write=several
    )
    if several:
        return every
    (only,) = every.fits.values()
    return only if isinstance(only, GroupFit) else next(iter(only.values()))


SIMULATED, FINISHED = "stored", "pieces"
"""Folders within that of fits: of a circuit's simulated trials, and of finished fits."""
Stages = Callable[[str], AbstractContextManager[Callable[[str], None]]]


def _silent(_: str) -> None:
    pass


def fit_all(
    one: Question,
    folder: Path | None = None,
    *,
    workers: int = 1,
    most_draws: int = MOST,
    chains_seed: int = HIERARCHY_SEED,
    write: bool = False,
    force: bool = False,
    note: Callable[[str], None] = _silent,
    stages: Stages = lambda _: nullcontext(_silent),
) -> Fits | GroupFits:
    """Fit every model to everyone, as ``fit``; finished fits in the folder are not repeated.

    ``write`` writes tables and figures to it, by ``force`` also in place of those of other fits.
    ``note`` is called with the report of each fit, and ``stages`` with its name, for a
    context that shows its progress.
    """
    if folder is None or not write:
        return _fitted(one, folder, workers, most_draws, chains_seed, note, stages)
    asked = one.asked
    # A group is fitted as a whole.
    people = [", ".join(one.people)] if asked.hierarchical else [*one.people]
    shared = settings_shared(asked, *one.data)
    place = FitFolder(folder, shared, people, [*one.versions], one.circuits(), asked.seed)
    compared = (COMPARISON,) if asked.compare else ()
    place.check((*(GROUP if asked.hierarchical else EACH), *compared), force, one.estimates())
    fits = _fitted(one, folder, workers, most_draws, chains_seed, note, stages)
    place.write(fits, note)
    return fits


def _fitted(
    one: Question, folder: Path | None, workers: int, most_draws: int, chains_seed: int,
    note: Callable[[str], None], stages: Stages,
) -> Fits | GroupFits:  # fmt: skip
    """Fit every model to everyone."""
    # Build all before any is fitted, so that errors are raised at once.
    by_model = {name: one.likelihoods(name) for name in one.versions}
    # A model that a user wrote may have changed in code that no key contains.
    own = any(
        not type(model).__module__.startswith("bgmodel.") for _, model, _ in one.versions.values()
    )
    store = None if folder is None or own else folder / FINISHED
    if one.asked.hierarchical:
        groups = {}
        for name, people in by_model.items():
            predictors = one.predictors(people)
            key: dict[str, Any] = {who: _key(one, who, each) for who, each in people.items()}
            key = {"people": key, "correlated": one.asked.people, "seed": chains_seed,
                   "predictors": {name: values.tolist() for name, values in zip(
                       predictors.names, predictors.columns, strict=True)}}  # fmt: skip
            with stages(name) as tell, collected() as cautions:
                groups[name] = fit_group(
                    people, predictors=predictors, seed=chains_seed, workers=workers,
                    most_draws=most_draws, correlated=one.asked.people == "correlated",
                    kept=None if store is None else chains_entry(store, stem(name), key), tell=tell,
                )  # fmt: skip
            for caution in cautions:
                FitWarning.warn(f"{name}: {caution}")
        return GroupFits(groups, compare_fits(groups) if one.asked.compare else None)
    fits: dict[str, dict[str, Fit]] = {name: {} for name in by_model}
    for who in next(iter(by_model.values())):
        for name, people in by_model.items():
            title = f"{who}, {name}"
            key = {**_key(one, who, people[who]), "posterior": one.asked.draws}
            entry = fit_entry(store, f"{who} {stem(name)}", key, people[who])
            kept = entry.get()
            if kept is None:
                with stages(title) as tell, collected() as cautions:
                    kept = fit_likelihood(people[who], draws=one.asked.draws, tell=tell), cautions
                entry.put(kept)
                note(report(kept[0], title))
            else:
                note(f"{title}: already done")
            fits[name][who] = kept[0]
            for caution in kept[1]:
                FitWarning.warn(f"{title}: {caution}")
    if not one.asked.compare:
        return Fits(fits)
    optima = {name: {who: fit.optimum for who, fit in each.items()} for name, each in fits.items()}
    with stages("comparison") as tell:
        return Fits(fits, crossvalidated(optima, tell=tell))


def _key(one: Question, who: str, likelihood: Likelihood) -> dict[str, Any]:
    """Return all that a fit depends on."""
    return {
        "participant": who,
        "data": one.people[who].checksum,
        "model": identity_of(likelihood.model),
        "free": likelihood.freedom.names,
        "values": [each.start for each in likelihood.freedom.parameters],
        "priors": likelihood.freedom.priors,
        "window_s": [f"{time:g}" for time in likelihood.design.observed.window_s],
        "left_out": likelihood.design.left_out,
    }


def simulate(
    model: ModelName,
    values: Mapping[str, float],
    trials: str | Path | pd.DataFrame | Trials,
    *,
    seed: int,
    **options: Any,
) -> Trials:
    """Return trials with the responses of a model, to see what a fit of them would find.

    Parameters
    ----------
    model, trials : as ``model`` and ``data`` of ``fit``
        The model, and the trials whose strengths, conditions, readings or rates of reward it meets.
        What their participants did is replaced, and so are the rewards.
    values : mapping from names to numbers
        Its parameters, by their names in ``Fit.summary()``; the others have their default values.
    seed : int
        Each participant has a separate random stream.
    **options
        Options of ``fit``: strength, columns, vary, formula, evidence, ...

    Returns
    -------
    Trials
        One participant after the other; for ``fit``, ``.to_hssm()`` and ``.to_pyddm()``.

    Raises
    ------
    ValueError
        As for ``fit``, and for a name that is none of the model's parameters.
    """
    need_fit()
    whole("seed", seed, 0)
    if not isinstance(values, Mapping):
        raise InputError.of("values", "must be a mapping from names to numbers", values)
    one = question(settings_of(**options), trials, [model])
    ((name, (asked, made, kind)),) = one.versions.items()
    free = next(iter(one.likelihoods(name).values())).freedom.names
    fixed = {key: value for key, value in values.items() if key not in free}
    if fixed:  # parameters that a fit holds by default
        more = settings_of(fix=fixed).fix
        asked = replace(asked, fix=(*asked.fix, *more))
        asked.check_parameters({name: made})
        one = replace(one, asked=asked, versions={name: (asked, made, kind)})
    parts = []
    for who, likelihood in one.likelihoods(name).items():
        freed = likelihood.freedom
        pairs = zip(freed.names, freed.start, strict=True)
        vector = np.array([float(values.get(key, usual)) for key, usual in pairs])
        ranges = zip(freed.names, freed.low, vector, freed.high, strict=True)
        outside = [f"{key} {low:g} to {up:g}" for key, low, x, up in ranges if not low <= x <= up]
        must = f"must lie within the ranges of the parameters ({', '.join(outside) or 'combined'})"
        require(freed.inside(vector), "values", must, dict(values))
        complete = likelihood.complete(vector)
        parts.append(complete.simulated(vector, stream(seed, "simulate", who)))
    return joined(parts)
