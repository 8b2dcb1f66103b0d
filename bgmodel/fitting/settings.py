"""Settings of a fit: columns of the table of trials, models, and free parameters."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import partial
from pathlib import Path
from typing import Any, Literal, Self, get_args

import numpy as np
import pandas as pd

from bgmodel.fitting.algorithms import GAPS, SIDED, GapModel
from bgmodel.fitting.design import Design, design_of
from bgmodel.fitting.formulas import Formula, formula_of
from bgmodel.fitting.hierarchy.group import Predictors
from bgmodel.fitting.likelihood import AnyModel, Likelihood, TrialModel, likelihood_of
from bgmodel.fitting.parameters import ADDED, Parameter
from bgmodel.fitting.responses import ENDS_S
from bgmodel.fitting.simulated.circuit_model import MECHANISMS, CircuitModel
from bgmodel.support.checks import check_flag, check_positive, check_unused, whole
from bgmodel.trials.columns import EVERYONE, Someone, of_participant
from bgmodel.trials.reader import OURS, Columns, read_trials
from bgmodel.trials.record import Trials, is_covariate
from bgmodel.trials.timed_readings import Source
from circuits.circuit import Circuit
from circuits.errors import InputError, require

People = Literal["each", "pooled", "hierarchical", "correlated"]


@dataclass(frozen=True, kw_only=True)
class FitSettings:
    """How a table of trials is read, and which parameters are fitted."""

    strength: str | None = None
    """Column of the signed strength of the evidence: positive favours response 1."""
    participant: Someone = None
    """The participant to fit, or several; by default all are."""
    people: People = "each"
    """How participants are fitted: each separately, pooled as if they were one, or all together,
    each with parameters from a distribution of the group, which is fitted too (partial pooling;
    hierarchical, or correlated if parameters may be correlated between people)."""
    columns: Columns = OURS
    """Names, units and codes of the columns of the table."""
    rt_window: tuple[float, float] | None = None
    """Earliest and latest response time to fit, s; 0 and inf keep all. By default, and without a
    deadline, times end at the upper quartile plus 25 interquartile ranges. The command prints how
    many trials are excluded."""
    mechanism: str = "threshold"
    """What changes the decision criterion of a circuit: threshold, dopamine, stn_loss or gpe_loss;
    or, with a threshold, a change within a trial: rising_dopamine, onset_stn or urgency."""
    free: tuple[str, ...] = ()
    """Parameters to fit; by default all except start, start_spread, drift_sd, floor, and a
    threshold that --mechanism replaces. With a plus, in addition to these: "+start"."""
    fix: tuple[str, ...] = ()
    """Parameters to fix at a value, such as "lapse=0.02"."""
    vary: tuple[str, ...] = ()
    """Parameters that differ between levels of a column: "sensitivity=conflict",
    "threshold=instruction"; "stn_loss=stimulation/off" fixes stn_loss at its start in level off."""
    formula: tuple[str, ...] = ()
    """Parameters that are linear in conditions, such as "bound ~ instruction * side" or
    "t0_s ~ block": a formula as in R, of columns of text (levels) or of numbers (covariates); in a
    hierarchy also of what differs between people, "bound ~ group"."""
    prior: tuple[str, ...] = ()
    """Priors of parameters, such as "t0_s=0.2:0.4": the central 95 % of where a person's value, or
    in a hierarchy the median person's, is believed to be."""
    draws: bool = False
    """Sample from the posterior too, for 90 % credible intervals; a hierarchical fit always
    does."""
    compare: bool = False
    """Compare the models by how well they predict trials that they were not fitted to. A single
    model is compared with versions in which one parameter of --vary or --formula has one value,
    which is fitted, for all conditions."""
    engine: str = "population"
    """Engine of the circuit: algebra, population, spikes, ..."""
    noise_nats: float = 2.0
    """Noise of the evidence in the circuit: its standard deviation after one second, nats."""
    trials: int = 16_000
    """Number of simulated trials of the circuit, at each of seven drifts."""
    seed: int = 24_001
    """Seed of the simulated trials."""
    evidence: Source | None = None
    """The readings of each trial; models then answer for each single trial."""
    step_ms: float | None = None
    """Time between readings, ms, if the evidence has steps instead of times."""
    forced: bool = False
    """Whether the last reading of a trial forces a response."""
    runs: int | None = None
    """Simulated runs of each trial by a circuit, if there is evidence; by default 8 to 32."""

    def check(self) -> None:
        """Raise ValueError for an invalid engine, noise or mechanism."""
        from circuits.engines import engine_of

        engine_of(self.engine)
        for name in ("draws", "compare"):
            check_flag(name, getattr(self, name))
        ways = get_args(People)
        known = isinstance(self.people, str) and self.people in ways
        require(known, "people", f"must be one of {', '.join(ways)}", self.people)
        require(isinstance(self.columns, Columns), "columns", "must be Columns(...)", self.columns)
        whole("trials", self.trials, 1)
        whole("seed", self.seed, 0)
        check_positive(noise_nats=self.noise_nats)
        if not isinstance(self.mechanism, str) or self.mechanism not in MECHANISMS:
            allowed = ", ".join(MECHANISMS)
            raise InputError.of("mechanism", f"must be one of {allowed}", self.mechanism)
        _ = self.priors

    @property
    def pooled(self) -> bool:
        """Whether all participants are fitted as if they were one."""
        return self.people == "pooled"

    @property
    def hierarchical(self) -> bool:
        """Whether all participants are fitted together, with a distribution of the group."""
        return self.people in ("hierarchical", "correlated")

    @property
    def by(self) -> list[str]:
        """Columns of the table that define conditions."""
        varied = {each.partition("/")[0] for each in self.varied.values()}
        return sorted(varied.union(*(each.columns for each in self._parsed)))

    @property
    def varied(self) -> dict[str, str]:
        """Parameters that differ between conditions, with their columns."""
        columns: dict[str, str] = {}
        for name, column in (_pair(each, "vary") for each in self.vary):
            if name in columns:
                raise InputError(f"{name} varies with two columns", "vary", self.vary)
            columns[name] = column
        return columns

    @property
    def effects(self) -> list[str]:
        """Parameters that may have one value for all conditions instead; see ``constant``."""
        varied = [name for name, column in self.varied.items() if "/" not in column]
        return [*varied, *self.formulas]

    @property
    def _parsed(self) -> list[Formula]:
        return [formula_of(each) for each in self.formula]

    @property
    def formulas(self) -> dict[str, Formula]:
        """Formulas, by the name of their parameter."""
        by_parameter: dict[str, Formula] = {}
        for each in self._parsed:
            if each.parameter in by_parameter:
                raise InputError(f"{each.parameter} has two formulas", "formula", self.formula)
            by_parameter[each.parameter] = each
        return by_parameter

    def split(self, trials: Trials) -> tuple[Self, list[Formula]]:
        """Return the settings without formulas of predictors between people, and these."""
        apart = set() if self.pooled else _between(trials)
        between = [each for each in self._parsed if apart & set(each.columns)]
        for name, column in self.varied.items():
            if column.partition("/")[0] in apart:
                problem = "differs between people alone, and vary is for conditions within them"
                raise InputError(f"{column} {problem}: give a formula, {name} ~ {column}", column)
        for each in between:
            column = sorted(apart & set(each.columns))[0]
            if not self.hierarchical:
                problem = "must differ between trials of a person: here it differs between people"
                raise InputError(
                    f"{column} {problem} alone. Fit them as a group (people hierarchical)",
                    column,
                )  # fmt: skip
            if set(each.columns) - apart:
                problem = f"{column} differs between people, and other columns within them"
                instead = f"give {each.parameter} two formulas, one of each kind"
                raise InputError(f"{problem}: {instead}", "formula", self.formula)
        written = zip(self._parsed, self.formula, strict=True)
        kept = tuple(text for each, text in written if not apart & set(each.columns))
        return replace(self, formula=kept), between

    def predictors(
        self, between: Sequence[Formula], trials: Trials, likelihoods: Mapping[str, Likelihood]
    ) -> Predictors:
        """Return the predictors between people for every number of their parameters."""
        first = next(iter(likelihoods.values()))
        rows = [int(np.argmax(trials.participant == who)) for who in likelihoods]
        levels = {str(name): [str(x) for x in trials.conditions[name].iloc[rows]]
                 for name in trials.conditions}  # fmt: skip
        names: list[str] = []
        columns, of, widths = [], [], []
        for each in between:
            parameter = own_name(each.parameter, first.model)
            made = each.matrix(levels, np.arange(len(rows)), len(rows))
            if made.pop("Intercept", None) is None:
                must = "must have an intercept: the group's mean"
                raise InputError.of("formula", must, f"{each.parameter} ~ {each.terms}")
            places = [k for k, x in enumerate(first.freedom.moved) if x.parameter.name == parameter]
            require(places, "formula", "must be of a parameter that is fitted", each.parameter)
            for label, column in made.items():
                for k in places:
                    names.append(f"{first.freedom.names[k]} by {label}")
                    # With a range of 1, so that the prior of a slope does not depend on the unit.
                    columns.append((column - column.mean()) / np.ptp(column))
                    widths.append(np.ptp(column))
                    of.append(k)
        return Predictors(tuple(names), np.array(columns), np.array(of), np.array(widths))

    @property
    def fixed(self) -> dict[str, float]:
        """Fixed parameters and their values."""
        return {name: _number(*pair) for name, *pair in (_pair(h, "fix") for h in self.fix)}

    @property
    def priors(self) -> dict[str, tuple[float, float]]:
        """Intervals of the priors that are asked for."""
        intervals = {}
        for text in self.prior:
            name, _, interval = text.rpartition("=")
            try:
                low, high = map(float, interval.split(":"))
            except ValueError:
                must = "must give two numbers, such as t0_s=0.2:0.4"
                raise InputError.of("prior", must, text) from None
            intervals[name.strip()] = low, high
        return intervals

    def with_priors(
        self, likelihoods: Mapping[str, Likelihood], model: AnyModel
    ) -> dict[str, Likelihood]:
        """Return likelihoods with the priors of parameters that their model has."""
        known, intervals = {each.name for each in model.parameters}, {}
        for name, interval in self.priors.items():
            parameter, bracket, condition = name.partition("[")
            parameter = own_name(parameter, model)
            if parameter in known:
                intervals[parameter + bracket + condition] = interval
        if not intervals:
            return dict(likelihoods)
        return {
            who: replace(each, freedom=each.freedom.with_priors(intervals))
            for who, each in likelihoods.items()
        }

    @property
    def named(self) -> tuple[str, ...]:
        """Names of ``free``, without plus signs."""
        return tuple(name.removeprefix(ADDED) for name in self.free)

    def constant(self, name: str) -> Self:
        """Return the settings with one free value of a parameter for all conditions."""
        plus = ADDED if not self.free or self.free[0].startswith(ADDED) else ""
        more = () if name in self.named else (f"{plus}{name}",)
        vary = tuple(each for each in self.vary if _pair(each, "vary")[0] != name)
        written = zip(self.formulas, self.formula, strict=True)
        formula = tuple(each for other, each in written if other != name)
        prior = tuple(each for each in self.prior if not each.startswith(f"{name}["))
        return replace(self, free=(*self.free, *more), vary=vary, formula=formula, prior=prior)

    def _freed(
        self, known: Mapping[str, Parameter], name_of: Callable[[str], str]
    ) -> list[str] | None:
        """Return the names of free parameters of a model; None for those that are by default."""
        added = [name.startswith(ADDED) for name in self.free]
        if any(added) and not all(added):
            must = "must have a plus before all names (in addition to the default) or before none"
            raise InputError.of("free", must, self.free)
        plus = ADDED if any(added) else ""
        named = [name_of(each) for each in self.named if name_of(each) in known]
        return [plus + each for each in dict.fromkeys(named)] or None

    def read(self, data: str | Path | pd.DataFrame | Trials) -> Trials:
        """Return the trials of a table, with the conditions of the fit, or those that are given."""
        if isinstance(data, Trials):
            reading = ("strength", "columns", "evidence", "step_ms", "forced")
            check_unused(self, reading, "on trials that are read (give it to read_trials)")
            lacking = [name for name in self.by if name not in data.conditions]
            must = "must be read with the trials: read_trials(..., conditions=...)"
            require(not lacking, "conditions", must, lacking)
            trials, who = data, data.participant
            if self.participant is not None:
                trials = data.where(of_participant(self.participant, who))
        else:
            trials = read_trials(
                data, strength=self.strength, conditions=self.by, participant=self.participant,
                columns=self.columns, evidence=self.evidence, step_ms=self.step_ms,
                forced=self.forced,
            )  # fmt: skip
        for name, column in self.varied.items():
            if is_covariate(trials.conditions[column.partition("/")[0]]):
                instead = f"give it a formula, {name} ~ {column}"
                raise InputError(f"{column} has too many values for vary: {instead}", "vary")
        return trials

    def by_person(self, choices: Trials) -> dict[str, Trials]:
        """Return the trials of each person to fit, or of all pooled."""
        if not self.pooled:
            return choices.by_participant()
        return {EVERYONE if self.participant is None else ", ".join(choices.people()): choices}

    def design(self, choices: Trials) -> Design:
        """Return one person's trials by cell (combination of strength and conditions)."""
        named = {*self.named, *self.varied, *self.fixed, *self.formulas}
        sides = not named.isdisjoint(SIDED)
        for each in self.formulas.values():
            each.check_trials(choices.conditions)
        return design_of(
            choices, self.by, rt_window=self.rt_window, pooled=self.pooled, sides=sides
        )

    def model(
        self,
        model: str | Path | Circuit | TrialModel,
        *,
        seconds: float = 3.0,
        folder: Path | None = None,
        alternatives: int | None = None,
    ) -> AnyModel:
        """Return a model by its name, as a circuit, or a ``TrialModel``; see ``fit_trials.fit``."""
        from bgmodel.fitting.simulated.alternatives import MODELS, ManyCircuitModel, check_many
        from circuits.anatomy import CIRCUITS, checked_circuit
        from circuits.declaration.table_writer import is_path

        if isinstance(model, TrialModel):
            return model
        number = alternatives or self.columns.alternatives or 2
        if number > 2:
            check_many(model, self.mechanism, number)
        if isinstance(model, str) and model in GAPS:
            return GapModel(GAPS[model])
        if isinstance(model, str) and model in MODELS:
            return MODELS[model](number, self.trials, self.seed, seconds)
        if isinstance(model, str) and model not in CIRCUITS and not is_path(model):
            allowed = ", ".join((*GAPS, *MODELS, *CIRCUITS))
            must = f"must be of {allowed}, or .toml files (constant_gap is the diffusion model, "
            must += "and learners need trials with the columns pair and reward)"
            raise InputError.of("models", must, model)
        circuit = checked_circuit(model, number)
        if number > 2 and circuit.channels != number:
            must = f"must have a channel for each of {number} alternatives"
            raise InputError.of("circuit", must, circuit.channels)
        kind = CircuitModel if number == 2 else ManyCircuitModel
        return kind(
            circuit,
            self.engine,
            MECHANISMS[self.mechanism],
            noise_nats=self.noise_nats,
            seconds=seconds,
            trials=self.trials,
            seed=self.seed,
            folder=folder,
        )

    def check_parameters(self, models: Mapping[str, AnyModel]) -> list[str]:
        """Return warnings of models that lack a free parameter; a name that none has is refused."""
        known = {each.name: 0 for model in models.values() for each in model.parameters}
        for option, names in (
            ("free", self.named), ("fix", self.fixed), ("vary", self.varied),
            ("formula", [each.parameter for each in self._parsed]),
            ("prior", [each.partition("[")[0] for each in self.priors]),
        ):  # fmt: skip
            for name in names:
                if name not in known and name != "threshold":
                    there = ", ".join({"threshold": 0} | known)
                    raise InputError.of(option, f"must name a parameter, one of {there}", name)
        warnings = []
        for name, model in models.items():
            parameters = {each.name for each in model.parameters} | {"threshold"}
            lacking = ", ".join(each for each in self.named if each not in parameters)
            if lacking and self.free[0].startswith(ADDED):
                warnings.append(f"{name} has no {lacking} and is fitted without")
            elif lacking:
                warnings.append(
                    f"{name} has no {lacking}, so all its parameters outside --free are fixed; "
                    "'threshold' is each model's own"
                )
        return warnings

    def likelihood(
        self, design: Design, model: AnyModel, largest: float | None = None
    ) -> Likelihood:
        """Return the likelihood of one person's trials; ``largest`` is as for ``likelihood_of``."""
        return likelihood_of(model, design, **self.freedom(model), largest=largest)

    def freedom(self, model: AnyModel) -> dict[str, Any]:
        """Return arguments of ``likelihood_of``, without parameters that only other models have."""
        known = {each.name: each for each in model.parameters}
        name_of = partial(own_name, model=model)
        fixed = {name_of(k): v for k, v in self.fixed.items()}
        vary = {name_of(k): v for k, v in self.varied.items()}
        if len(vary) < len(self.varied):
            message = f"threshold is {name_of('threshold')} here, which varies with two columns"
            raise InputError(message, "vary", self.vary)
        return {
            "free": self._freed(known, name_of),
            "fixed": {k: v for k, v in fixed.items() if k in known},
            "vary": {k: v for k, v in vary.items() if k in known},
            "formulas": [
                replace(each, parameter=name_of(name))
                for name, each in self.formulas.items()
                if name_of(name) in known
            ],
        }


def own_name(name: str, model: AnyModel) -> str:
    """Return a model's own name of a parameter: "threshold" is what sets its criterion."""
    return getattr(model, "threshold_name", name) if name == "threshold" else name


def shared_ranges(likelihoods: Mapping[str, Likelihood]) -> dict[str, Likelihood]:
    """Return likelihoods whose coefficients have one range: the widest of any person."""
    every = [each.freedom for each in likelihoods.values()]
    if len({tuple(each.names) for each in every}) > 1:
        return dict(likelihoods)  # people with other levels, which the hierarchy refuses
    low, high = (
        np.min([each.low for each in every], axis=0),
        np.max([each.high for each in every], axis=0),
    )
    shared = {}
    for who, each in likelihoods.items():
        moved = tuple(
            replace(one, parameter=replace(one.parameter, low=float(a), high=float(b)))
            for one, a, b in zip(each.freedom.moved, low, high, strict=True)
        )
        shared[who] = replace(each, freedom=replace(each.freedom, moved=moved))
    return shared


EXAMPLES = {"fix": '{"lapse": 0.02}', "vary": '{"sensitivity": "conflict"}',
            "prior": '{"t0_s": (0.2, 0.4)}'}  # fmt: skip
"""Examples of mappings of parameters for ``fit``."""


def _between(trials: Trials) -> set[str]:
    """Return the conditions that differ between people, and within none of them."""
    between = set()
    for name, levels in trials.conditions.items():
        kinds = levels.groupby(trials.participant).nunique()
        if len(kinds) > 1 and (kinds == 1).all() and levels.nunique() > 1:
            between.add(str(name))
    return between


def settings_of(
    *,
    free: Sequence[str] | str = (),
    fix: Mapping[str, float] | None = None,
    vary: Mapping[str, str] | None = None,
    formula: Sequence[str] | str = (),
    prior: Mapping[str, tuple[float, float]] | None = None,
    **others: Any,
) -> FitSettings:
    """Return checked settings from the arguments of ``fit``; ValueError for an unknown name."""
    known = {each.name for each in fields(FitSettings)}
    for name in others:
        if name not in known:
            raise InputError(f"no option is called {name!r}; they are {', '.join(known)}", name)
    asked = FitSettings(
        free=names_of(free),
        fix=tuple(f"{name}={value!r}" for name, value in _pairs("fix", fix)),
        vary=tuple(f"{name}={column}" for name, column in _pairs("vary", vary)),
        formula=names_of(formula, "formula"),
        prior=tuple(
            f"{name}={':'.join(map(str, pair)) if isinstance(pair, (tuple, list)) else pair}"
            for name, pair in _pairs("prior", prior)
        ),
        **others,
    )
    asked.check()
    return asked


def seconds_of(designs: Iterable[Design]) -> float:
    """Return the length of the longest fitted trial, s, rounded up to half seconds to be shared."""
    seen = [design.observed for design in designs]
    ends = [each.deadline_s or np.fmax.reduce(each.rt_s) for each in seen]
    longest = ENDS_S if np.isnan(ends).all() else float(np.nanmax(ends))
    return float(np.ceil(2 * longest) / 2)


def need_fit() -> None:
    """Raise ImportError with installation advice if the libraries of fits are missing."""
    try:
        import arviz_stats  # noqa: F401
        import cma  # noqa: F401
        import emcee  # noqa: F401
        import h5netcdf  # noqa: F401
    except ImportError as error:
        needed = "cma, emcee, arviz-stats and h5netcdf"
        raise ImportError(f'fits need {needed}: pip install ".[fit]"') from error


def names_of(names: str | Iterable[str], option: str = "free") -> tuple[str, ...]:
    """Return one name, or several, as a tuple; ValueError for anything else."""
    texts = isinstance(names, (str, list, tuple)) and all(isinstance(each, str) for each in names)
    if not texts:
        kind = "the name of a parameter" if option == "free" else "a formula"
        raise InputError.of(option, f"must be {kind}, or a list of them", names)
    return (names,) if isinstance(names, str) else tuple(names)


def _pairs(option: str, settings: Mapping[str, object] | None) -> Iterable[tuple[str, object]]:
    if not isinstance(settings, Mapping | None):
        raise InputError.of(option, f"must be a mapping such as {EXAMPLES[option]}", settings)
    return (settings or {}).items()


def _pair(text: str, option: str) -> tuple[str, str]:
    name, equals, value = text.partition("=")
    if not equals or not value:
        example = "lapse=0.02" if option == "fix" else "threshold=instruction"
        example = f"{option} is a name, =, and a value, such as {example}"
        raise InputError(f"{example}, got {text!r}", option, text)
    return name.strip(), value.strip()


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise InputError.of("fix", "must give a number, such as lapse=0.02", text) from None
