"""The command that fits models to choice and response-time data."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from bgmodel.commands.fitted import TABLES, Kept
from bgmodel.commands.group_fits import fit_hierarchically
from bgmodel.commands.known_fits import fit_known_evidence
from bgmodel.commands.options import MANY, record_of, values
from bgmodel.commands.output import UNRECORDED, Output, check_whole, plain, recorded, say
from bgmodel.commands.stop_fits import DEFAULT_MODELS, fit_stop_signals
from bgmodel.fitting.hierarchy.group import ALIKE
from bgmodel.fitting.settings import FitSettings, need_fit, seconds_of
from bgmodel.support import files
from bgmodel.trials.reading import OURS
from bgmodel.version import __version__
from circuits.errors import InputError

if TYPE_CHECKING:
    from bgmodel.fitting.likelihood import AnyModel

EVIDENCE_ONLY = ("step_ms", "forced", "runs")
"""Options that need --evidence."""
MANY_MODELS = ("msprt", "macaque")
"""Default models of more than two alternatives."""


OF_SIMULATION = ("trials", "seed", "engine", "noise_nats")
"""Settings of simulated trials, given by --simulation."""
PEOPLE = Literal["each", "pooled", "hierarchical"]


def fit(
    data: str = "",
    folder: Path | None = None,
    /,
    *,
    models: Annotated[tuple[str, ...] | None, MANY] = None,
    strength: str | None = None,
    participant: str | None = None,
    people: PEOPLE = "each",
    columns: Annotated[tuple[str, ...], MANY] = (),
    vary: Annotated[tuple[str, ...], MANY] = (),
    formula: Annotated[tuple[str, ...], MANY] = (),
    free: Annotated[tuple[str, ...], MANY] = (),
    fix: Annotated[tuple[str, ...], MANY] = (),
    mechanism: str = FitSettings.mechanism,
    simulation: Annotated[tuple[str, ...], MANY] = (),
    draws: bool = False,
    compare: bool = False,
    evidence: Annotated[tuple[str, ...], MANY] = (),
    task: Literal["choices", "stop"] = "choices",
    workers: int = 2,
    json: bool = False,
    force: bool = False,
) -> None:
    """Fit the sequential test and a circuit to choice and response-time data.

    DATA is a shipped set or your own table: participant_id, rt (s), response, conditions. Without
    DATA it lists the shipped sets, with their sources. For each participant and model it prints
    which parameters these trials can identify, and at the end the maximum-likelihood parameters.
    Simulated trials and finished fits are kept in FOLDER (by default fits/ and the name of the
    data): the same command resumes where it stopped.

    Examples: bgmodel fit roitman_shadlen_2002 --strength coherence --participant b;
    bgmodel fit mine.csv --strength contrast --vary threshold=instruction;
    bgmodel fit mine.csv --strength contrast --formula "bound ~ instruction * side";
    bgmodel fit mine.csv --strength contrast --columns rt=RT_ms rt_unit=ms;
    bgmodel fit cavanagh_2011 --people hierarchical --models constant_gap
    --vary sensitivity=conflict;
    bgmodel fit stop_signal_cnp --task stop --columns restore_delays=true;
    bgmodel fit trials.csv --evidence evidence.csv --models msprt leaky_sum run macaque

    Parameters
    ----------
    data
        Name of a shipped set, or a .csv, .tsv or .parquet file.
    folder
        Folder for results.
    models
        Models: constant_gap, falling_gap, hyperbolic_gap, weibull_gap (two alternatives), msprt,
        race, lca (two or more), or a circuit, by its name or as a .toml file. By default
        constant_gap and macaque, or msprt and macaque with more than two alternatives.
    strength
        Column of the signed strength of the evidence: positive favours response 1.
    participant
        The participant to fit; by default all are.
    people
        How participants are fitted: each separately, pooled as if they were one, or all together,
        each with parameters from a distribution of the group, which is fitted too (partial
        pooling); this writes the draws for ArviZ.
    columns
        How the table is read, name=value: rt, response, participant, ssd and trial_type (columns
        of other names), rt_unit (s or ms), upper (the response that counts as 1), alternatives
        (their number), stimulus (column of the correct alternative), deadline_s (time at which a
        trial without a response ended), rt_window (earliest and latest response time to fit, s, as
        0,inf for all), restore_delays (of stop signals, those recorded as 0).
    vary
        Parameters that differ between levels of a column: "sensitivity=conflict",
        "threshold=instruction"; "stn_loss=stimulation/off" fixes stn_loss at its start in level
        off.
    formula
        Parameters that are linear in conditions, such as "bound ~ instruction * side" or
        "t0_s ~ block": a formula as in R, of columns of text (levels) or of numbers (covariates).
        With --people hierarchical also of what differs between people, "bound ~ group".
    free
        Parameters to fit; by default all except start, start_spread, drift_sd, floor, and a
        threshold that --mechanism replaces. With a plus, in addition to these: "+start".
    fix
        Parameters to fix at a value, such as "lapse=0.02".
    mechanism
        What changes the decision criterion of a circuit: threshold, dopamine, stn_loss or gpe_loss;
        or, with a threshold, a change within a trial: rising_dopamine or onset_stn.
    simulation
        Simulated trials of a circuit, name=value: trials at each of seven drifts, seed, engine,
        noise_nats (noise of the evidence: its standard deviation after one second, nats).
    draws
        Sample from the posterior too: adds 90 % credible intervals.
    compare
        Compare the models by how well they predict trials that they were not fitted to: writes
        comparison.csv and comparison.png. A single model is compared with versions in which one
        parameter of --vary or --formula has one value, which is fitted, for all conditions.
    evidence
        File with the readings of each trial, for models that answer for each trial:
        columns trial, step and `ll_<alternative>`; trial, time (s) and `ll_<alternative>`; or one
        row per cue with trial, time and side or value (nats). Then name=value: step_ms (time
        between readings, if the table has steps), forced=true (the last reading forces a response),
        runs (simulated runs of each trial by a circuit; by default 8 to 32).
    task
        What DATA holds: choices, or stop-signal trials, of which all participants are fitted
        together.
    workers
        Number of processes of a hierarchical fit; the results do not depend on it.
    json
        Print one JSON object, the rows of the result under "records", and nothing else on stdout.
    force
        Overwrite existing results.
    """
    output = Output(json=json, force=force)
    if not data:
        _list(output)
        return
    words = list(evidence)
    file = Path(words.pop(0)) if words else None
    FitRun(
        data=data, folder=folder, models=models, strength=strength, participant=participant,
        pooled=people == "pooled", hierarchical=people == "hierarchical", vary=vary,
        formula=formula, free=free, fix=fix, mechanism=mechanism, draws=draws, compare=compare,
        evidence=file, task=task, workers=workers, output=output,
        **_of_columns(columns), **values(simulation, FitRun, OF_SIMULATION),
        **values(words, FitRun, EVIDENCE_ONLY),
    )()  # fmt: skip


def _of_columns(words: Sequence[str]) -> dict[str, Any]:
    """Return the settings of --columns: how the table is read, and the window of times."""
    window = [word for word in words if word.partition("=")[0] == "rt_window"]
    rest = [word for word in words if word not in window]
    return {"columns": record_of(OURS, rest), **values(window, FitRun, ("rt_window",))}


def _list(output: Output) -> None:
    """List the published data sets that come with the package, with their sources."""
    import pandas as pd

    from bgmodel.tables.shipped import every_set

    sets = every_set().values()
    rows = [{"name": one.name, "trials": one.trials, "participants": one.people,
             "strength": one.strength, "conditions": ", ".join(one.conditions), **one.about}
            for one in sets]  # fmt: skip
    output.show("\n\n".join(one.text() for one in sets), pd.DataFrame(rows))


@dataclass(frozen=True, kw_only=True)
class FitRun(FitSettings):
    """One run of the command: its settings, see ``fit``, and where its results go."""

    data: str
    folder: Path | None = None
    models: tuple[str, ...] | None = None
    draws: bool = False
    compare: bool = False
    workers: int = 2
    task: str = "choices"
    evidence: Path | None = None
    step_ms: float | None = None
    forced: bool = False
    runs: int | None = None
    output: Output = Output()  # noqa: RUF009

    def check_idle(self, used: Iterable[str], reason: str) -> None:
        """Raise ValueError for an option that was given though it is not among those in use."""
        for each in fields(self):
            if each.name not in used and getattr(self, each.name) != each.default:
                name = "people" if each.name in ("pooled", "hierarchical") else each.name
                said = f"{name} has no effect with {reason}: leave it out"
                raise InputError(said, each.name)

    def __call__(self) -> None:
        """Run the command."""
        if self.evidence is not None:
            fit_known_evidence(self)
            return
        self._check_needs_evidence()
        need_fit()
        check_whole(trials=self.trials, workers=self.workers)
        self.check()
        if self.models == ():
            raise InputError("models must name at least one", "models")
        if self.task == "stop":
            fit_stop_signals(self)
            return
        try:
            self._fit()
        except KeyboardInterrupt:
            raise KeyboardInterrupt(
                "Finished fits and simulated trials are kept: the same command resumes there."
            ) from None

    def _fit(self) -> None:
        """Fit choices and response times."""
        choices = self.read(self.data)
        names = self._models(choices.alternatives)
        self.check_kind(choices, [self.model(name) for name in names])
        asked, between = self.split(choices)
        if self.compare and self._alone() and not asked.effects:
            must = "needs at least two models, or one with --vary or --formula"
            raise InputError.of("compare", must, ", ".join(names))
        folder = self.folder or Path("fits") / Path(self.data).stem
        people = asked.people(choices)
        designs = {who: asked.design(some) for who, some in people}
        more: dict[str, Any] = {"folder": folder / "stored", "alternatives": choices.alternatives}
        more["seconds"] = seconds_of(designs.values())
        models = {each: asked.model(each, **more) for each in names}
        for lacking in asked.check_parameters(models):
            say(lacking)
        versions = asked._versions(models)
        circuits = _circuits({name: model for name, (_, model) in versions.items()})
        if self.hierarchical:
            made = {name: own.likelihoods(designs, each) for name, (own, each) in versions.items()}
            apart = {
                name: asked.predictors(between, choices, each) if between else ALIKE
                for name, each in made.items()
            }
            options = {**self._asked(), "circuits": circuits}
            fit_hierarchically(self, folder, options, made, apart, choices.checksum)
            return
        kept = Kept(
            folder, self.seed, self._asked(), circuits,
            self.draws, self.output.note,
        )  # fmt: skip
        kept.check(self.output.force)
        # Build all before any is fitted, so that errors are raised at once.
        likelihoods = {
            who: {name: own.likelihood(design, each) for name, (own, each) in versions.items()}
            for who, design in designs.items()
        }
        self.output.note(choices.summary())
        fitted = [kept.person(who, some, likelihoods[who]) for who, some in people]
        found = [each for person in fitted for each in person]
        parameters = kept.gather(found)
        if self.compare:
            self.output.note("\n" + kept.compare(fitted, likelihoods))
        self.output.show("\n" + parameters.round(4).to_string(index=False), parameters)
        self.output.note(f"-> {folder}: {', '.join(TABLES)}, a figure for each participant")

    def _models(self, alternatives: int) -> tuple[str, ...]:
        """Return the models to fit; by default those for a number of alternatives."""
        return self.models or (MANY_MODELS if alternatives > 2 else DEFAULT_MODELS)

    def _alone(self) -> bool:
        """Return whether a single model is asked for."""
        return self.models is not None and len(self.models) == 1

    def _versions(self, models: Mapping[str, AnyModel]) -> dict[str, tuple[FitSettings, AnyModel]]:
        """Return the models with their settings, and a single one without each of its effects."""
        found: dict[str, tuple[FitSettings, AnyModel]] = {
            name: (self, model) for name, model in models.items()
        }
        if self.compare and self._alone():
            ((name, model),) = models.items()
            for effect in self.effects:
                found[f"{plain(name)}, same {effect}"] = self.constant(effect), model
        return found

    def _check_needs_evidence(self) -> None:
        """Raise ValueError for an option of known evidence without any."""
        for name in EVIDENCE_ONLY:
            if getattr(self, name):
                raise InputError(f"{name} needs --evidence", name)

    def _asked(self) -> dict[str, Any]:
        """Return the options that all fits in one folder must share; participants may differ."""
        own = ("data", "folder", "models", "participant", "draws", "task",
               "hierarchical", "compare", "evidence", *EVIDENCE_ONLY, *UNRECORDED)  # fmt: skip
        named = {each.name for each in fields(self)} - set(own)
        said = {name: recorded(getattr(self, name)) for name in sorted(named)}
        if self.rt_window is not None:
            # As text, since JSON has no infinity.
            said["rt_window"] = [f"{time:g}" for time in self.rt_window]
        simulated = {"simulated_trials": said.pop("trials"), "simulation_seed": self.seed}
        # Of the whole table: participants may be fitted one after the other.
        file = Path(self.data)
        trials = files.checksum(file) if file.is_file() else self.data
        version = {"bgmodel": __version__}
        return {"data": self.data, "trials": trials, **simulated, **said, **version}


def _circuits(models: Mapping[str, AnyModel]) -> dict[str, str]:
    """Return the hash of the circuit of each model that has one."""
    from bgmodel.fitting.likelihood import identity_of

    made = {name: identity_of(model).get("circuit") for name, model in models.items()}
    return {name: each["sha256"] for name, each in made.items() if isinstance(each, dict)}
