"""The command that fits models to choice and response-time data."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Annotated, Any, Literal

from bgmodel.commands.fitted import TABLES, Kept
from bgmodel.commands.group_fits import fit_hierarchically
from bgmodel.commands.options import MANY, Workers, record_of, values
from bgmodel.commands.output import UNRECORDED, Output, check_whole, recorded, say
from bgmodel.fits import Question, question
from bgmodel.fitting.settings import FitSettings, need_fit
from bgmodel.support import files
from bgmodel.trials.reading import OURS
from bgmodel.version import __version__
from circuits.errors import InputError, require

OF_EVIDENCE = ("step_ms", "forced", "runs")
"""Settings of known evidence, given by --evidence."""
OF_SIMULATION = ("trials", "seed", "engine", "noise_nats")
"""Settings of simulated trials, given by --simulation."""
ESTIMATES = "estimates.csv"
"""Table of estimates without a model, such as SSRT by integration, for trials that have any."""
PEOPLE = Literal["each", "pooled", "hierarchical", "correlated"]


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
    prior: Annotated[tuple[str, ...], MANY] = (),
    mechanism: str = FitSettings.mechanism,
    simulation: Annotated[tuple[str, ...], MANY] = (),
    draws: bool = False,
    compare: bool = False,
    evidence: Annotated[tuple[str, ...], MANY] = (),
    workers: Workers = 2,
    json: bool = False,
    force: bool = False,
) -> None:
    """Fit the sequential test and a circuit to choice and response-time data.

    DATA is a shipped set or your own table: participant_id, rt (s), response, conditions. Without
    DATA it lists the shipped sets, with their sources. For each participant and model it prints
    which parameters these trials can identify, and at the end the maximum-likelihood parameters.
    Simulated trials and finished fits are kept in FOLDER (by default fits/ and the name of the
    data): the same command resumes where it stopped.

    The columns of DATA say what kind of trials they are: with rewards they are fitted by learners,
    with stop-signal delays by stop processes, and with --evidence by models that answer for each
    trial.

    Examples: bgmodel fit roitman_shadlen_2002 --strength coherence --participant b;
    bgmodel fit mine.csv --strength contrast --vary threshold=instruction;
    bgmodel fit mine.csv --strength contrast --formula "bound ~ instruction * side";
    bgmodel fit mine.csv --strength contrast --columns rt=RT_ms rt_unit=ms;
    bgmodel fit cavanagh_2011 --people hierarchical --models constant_gap
    --vary sensitivity=conflict;
    bgmodel fit stop_signal_cnp --people hierarchical --models constant_gap
    --columns restore_delays=true;
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
        constant_gap and macaque, or msprt and macaque with more than two alternatives. Of rewarded
        choices: "no learning", q, "q, two rates", "logit q", confidence, "confidence, two rates",
        opal. Of stop-signal trials: constant_gap or a circuit. With --evidence: msprt, leaky_sum,
        run or a circuit.
    strength
        Column of the signed strength of the evidence: positive favours response 1.
    participant
        The participant to fit; by default all are.
    people
        How participants are fitted: each separately, pooled as if they were one, or all together,
        each with parameters from a distribution of the group, which is fitted too (partial
        pooling; hierarchical, or correlated if parameters may be correlated between people); this
        writes the draws for ArviZ.
    columns
        How the table is read, name=value: rt, response, participant, ssd and trial_type (columns
        of other names), rt_unit (s or ms), upper (the response that counts as 1), alternatives
        (their number), stimulus (column of the correct alternative), deadline_s (time at which a
        trial without a response ended), withheld (the response of a go/no-go task that is given by
        waiting until then), rt_window (earliest and latest response time to fit, s, as
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
    prior
        Priors of parameters, name=low:high, such as "t0_s=0.2:0.4": the central 95 % of where a
        person's value, or in a hierarchy the median person's, is believed to be.
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
        pooled=people == "pooled", hierarchical=people in ("hierarchical", "correlated"),
        correlated=people == "correlated", vary=vary, formula=formula, free=free, fix=fix,
        prior=prior, mechanism=mechanism, draws=draws, compare=compare, evidence=file,
        workers=workers, output=output,
        **_of_columns(columns), **values(simulation, FitRun, OF_SIMULATION),
        **values(words, FitRun, OF_EVIDENCE),
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
    correlated: bool = False
    workers: int = 2
    output: Output = Output()  # noqa: RUF009

    def __call__(self) -> None:
        """Run the command."""
        need_fit()
        check_whole(trials=self.trials, workers=self.workers)
        self.check()
        if self.models == ():
            raise InputError("models must name at least one", "models")
        try:
            self._fit()
        except KeyboardInterrupt:
            raise KeyboardInterrupt(
                "Finished fits and simulated trials are kept: the same command resumes there."
            ) from None

    def _fit(self) -> None:
        """Fit each model to each participant, or to all of them."""
        folder = self.folder or Path("fits") / Path(self.data).stem
        one = question(self, self.data, self.models, folder / "stored")
        if self.compare and len(one.versions) == 1:
            (name,) = one.versions
            one.add_constant(name)
            must = "needs at least two models, or one with --vary or --formula"
            require(len(one.versions) > 1, "compare", must, name)
        for lacking in one.lacking:
            say(lacking)
        circuits = _circuits(one)
        estimates = one.estimates()
        if estimates is not None:
            path = folder / ESTIMATES
            files.check_new(path, force=files.is_result(path))
            files.write_table(estimates, path, seed=self.seed, **self._asked())
        if self.hierarchical:
            options = {**self._asked(), "circuits": circuits}
            fit_hierarchically(self, folder, options, one)
            return
        kept = Kept(
            folder, self.seed, self._asked(), circuits,
            self.draws, self.output.note,
        )  # fmt: skip
        kept.check(self.output.force)
        # Build all before any is fitted, so that errors are raised at once.
        by_model = {name: one.likelihoods(name) for name in one.versions}
        likelihoods = {
            who: {name: each[who] for name, each in by_model.items()}
            for who in next(iter(by_model.values()))
        }
        self.output.note(one.trials.summary())
        fitted = [kept.person(who, one.people[who], each) for who, each in likelihoods.items()]
        pieces = [each for person in fitted for each in person]
        parameters = kept.gather(pieces)
        if self.compare:
            self.output.note("\n" + kept.compare(fitted, likelihoods))
        self.output.show("\n" + parameters.round(4).to_string(index=False), parameters)
        self.output.note(f"-> {folder}: {', '.join(TABLES)}, a figure for each participant")

    def _asked(self) -> dict[str, Any]:
        """Return the options that all fits in one folder must share; participants may differ."""
        unshared = ("data", "folder", "models", "participant", "draws",
                    "hierarchical", "compare", "evidence", *UNRECORDED)  # fmt: skip
        named = {each.name for each in fields(self)} - set(unshared)
        options = {name: recorded(getattr(self, name)) for name in sorted(named)}
        if self.rt_window is not None:
            # As text, since JSON has no infinity.
            options["rt_window"] = [f"{time:g}" for time in self.rt_window]
        simulated = {"simulated_trials": options.pop("trials"), "simulation_seed": self.seed}
        # Of the whole table: participants may be fitted one after the other.
        file = Path(self.data)
        trials = files.checksum(file) if file.is_file() else self.data
        known = (
            {} if self.evidence is None else {"evidence": files.checksum(Path(str(self.evidence)))}
        )
        version = {"bgmodel": __version__}
        return {"data": self.data, "trials": trials, **known, **simulated, **options, **version}


def _circuits(one: Question) -> dict[str, str]:
    """Return the hash of the circuit of each model that has one."""
    from bgmodel.fitting.likelihood import identity_of

    made = {name: identity_of(model).get("circuit") for name, (_, model, _) in one.versions.items()}
    return {name: each["sha256"] for name, each in made.items() if isinstance(each, dict)}
