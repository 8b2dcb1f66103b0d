"""The command that fits models to choice and response-time data."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from tyro.conf import Positional

from bgmodel.commands.checks import UNRECORDED, Shows, check_whole, plain, recorded, say
from bgmodel.commands.fitted import TABLES, Kept
from bgmodel.commands.group_fits import fit_hierarchically
from bgmodel.commands.known_fits import fit_known_evidence
from bgmodel.commands.stop_fits import DEFAULT_MODELS, fit_stop_signals
from bgmodel.fitting.settings import FitSettings, need_fit, seconds_of
from bgmodel.support import files
from bgmodel.version import __version__
from circuits.errors import InputError

if TYPE_CHECKING:
    from bgmodel.fitting.exact.algorithms import Model

EVIDENCE_ONLY = ("step_ms", "forced", "runs")
"""Options that need --evidence."""
MANY_MODELS = ("msprt", "macaque")
"""Default models of more than two alternatives."""


@dataclass(frozen=True)
class FitRun(FitSettings, Shows):
    """Fit the sequential test and a circuit to choice and response-time data.

    DATA is a shipped set (see `bgmodel data`) or your own table: participant_id, rt (s), response,
    conditions. For each participant and model it prints which parameters these trials can identify,
    and at the end the maximum-likelihood parameters. Simulated trials and finished fits are kept in
    the folder: the same command resumes where it stopped.

    Examples: bgmodel fit roitman_shadlen_2002 --strength coherence --participant b;
    bgmodel fit mine.csv --strength contrast --vary threshold=instruction;
    bgmodel fit mine.csv --strength contrast --formula "bound ~ instruction * side";
    bgmodel fit mine.csv --strength contrast --mechanism onset_stn --draws

    With --hierarchical all participants are fitted together:
    bgmodel fit cavanagh_2011 --hierarchical --models constant_gap --vary sensitivity=conflict

    With --task stop, DATA holds stop-signal trials: stop_signal_cnp, a table with participant_id,
    rt and ssd (s), or a folder of BIDS events. All participants are fitted together:
    bgmodel fit stop_signal_cnp --task stop --restore-delays

    With --evidence, models answer for the readings of each single trial (log-likelihoods, or
    pulses, clicks and cues with their times), and are compared by Bayes factors:
    bgmodel fit trials.csv --evidence evidence.csv --models msprt leaky_sum run macaque
    """

    data: Positional[str]
    """Name of a shipped set, or a .csv, .tsv or .parquet file."""
    folder: Positional[Path | None] = None
    """Folder for results; by default fits/ and the name of the data."""
    models: tuple[str, ...] | None = None
    """Models: constant_gap, falling_gap, hyperbolic_gap, weibull_gap (two alternatives), msprt,
    race, lca (two or more), or a circuit, by its name or as a .toml file. By default constant_gap
    and macaque, or msprt and macaque with more than two alternatives."""
    draws: bool = False
    """Sample from the posterior too: adds 90 % credible intervals."""
    hierarchical: bool = False
    """Fit all participants together: each has parameters from a distribution of the group, which
    is fitted too (partial pooling). Writes the draws for ArviZ."""
    compare: bool = False
    """Compare the models by how well they predict trials that they were not fitted to: writes
    comparison.csv and comparison.png. A single model is compared with versions in which one
    parameter of --vary or --formula has one value, which is fitted, for all conditions."""
    workers: int = 2
    """Number of processes of a hierarchical fit; the results do not depend on it."""
    task: Literal["choices", "stop"] = "choices"
    """What DATA holds: choices between two alternatives, or stop-signal trials."""
    restore_delays: bool = False
    """With --task stop: infer stop-signal delays recorded as 0, because the response came before
    the signal, from two interleaved staircases with steps of 50 ms."""

    evidence: Path | None = None
    """The readings of each trial: columns trial, step and ll_<alternative>; trial, time (s) and
    ll_<alternative>; or one row per cue with trial, time and side or value (nats)."""
    step_ms: float | None = None
    """With --evidence: time between readings, ms, if the table has steps instead of times."""
    forced: bool = False
    """With --evidence: the last reading of a trial forces a response."""
    runs: int | None = None
    """With --evidence: simulated runs of each trial by a circuit; by default 8 to 32."""

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
        if self.compare and self._alone() and not self.effects:
            must = "needs at least two models, or one with --vary or --formula"
            raise InputError.of("compare", must, ", ".join(self.models or ()))
        if self.task == "stop":
            fit_stop_signals(self)
            return
        if self.restore_delays:
            raise InputError("--restore-delays needs --task stop", "restore_delays")
        try:
            self._fit()
        except KeyboardInterrupt:
            raise KeyboardInterrupt(
                "Finished fits and simulated trials are kept: the same command resumes there."
            ) from None

    def _fit(self) -> None:
        """Fit choices and response times."""
        choices = self.read(self.data)
        folder = self.folder or Path("fits") / Path(self.data).stem
        people = self.people(choices)
        designs = {who: self.design(some) for who, some in people}
        more: dict[str, Any] = {"folder": folder / "stored", "alternatives": choices.alternatives}
        more["seconds"] = seconds_of(designs.values())
        models = {each: self.model(each, **more) for each in self._models(choices.alternatives)}
        for lacking in self.check_parameters(models):
            say(lacking)
        versions = self._versions(models)
        circuits = _circuits({name: model for name, (_, model) in versions.items()})
        if self.hierarchical:
            made = {name: own.likelihoods(designs, each) for name, (own, each) in versions.items()}
            asked = {**self._asked(), "circuits": circuits}
            fit_hierarchically(self, folder, asked, made, choices.checksum)
            return
        kept = Kept(
            folder, self.seed, self._asked(), circuits,
            self.draws, self.note,
        )  # fmt: skip
        kept.check(self.force)
        # Build all before any is fitted, so that errors are raised at once.
        likelihoods = {
            who: {name: own.likelihood(design, each) for name, (own, each) in versions.items()}
            for who, design in designs.items()
        }
        self.note(choices.summary())
        fitted = [kept.person(who, some, likelihoods[who]) for who, some in people]
        found = [each for person in fitted for each in person]
        parameters = kept.gather(found)
        if self.compare:
            self.note("\n" + kept.compare(fitted, likelihoods))
        self.show("\n" + parameters.round(4).to_string(index=False), parameters)
        self.note(f"-> {folder}: {', '.join(TABLES)}, a figure for each participant")

    def _models(self, alternatives: int) -> tuple[str, ...]:
        """Return the models to fit; by default those for a number of alternatives."""
        return self.models or (MANY_MODELS if alternatives > 2 else DEFAULT_MODELS)

    def _alone(self) -> bool:
        """Return whether a single model is asked for."""
        return self.models is not None and len(self.models) == 1

    def _versions(self, models: Mapping[str, Model]) -> dict[str, tuple[FitSettings, Model]]:
        """Return the models with their settings, and a single one without each of its effects."""
        found: dict[str, tuple[FitSettings, Model]] = {
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
                raise InputError(f"--{name.replace('_', '-')} needs --evidence", name)

    def _asked(self) -> dict[str, Any]:
        """Return the options that all fits in one folder must share; participants may differ."""
        own = ("data", "folder", "models", "participant", "draws", "task", "restore_delays",
               "hierarchical", "compare", "evidence", *EVIDENCE_ONLY, *UNRECORDED)  # fmt: skip
        named = {each.name for each in fields(self)} - set(own)
        said = {name: recorded(getattr(self, name)) for name in sorted(named)}
        for name in ("formula", "alternatives", "stimulus"):
            if not said[name]:
                del said[name]  # so that tables of earlier versions can be added to
        if self.rt_window is not None:
            # As text, since JSON has no infinity.
            said["rt_window"] = [f"{time:g}" for time in self.rt_window]
        simulated = {"simulated_trials": said.pop("trials"), "simulation_seed": self.seed}
        # Of the whole table: participants may be fitted one after the other.
        file = Path(self.data)
        trials = files.checksum(file) if file.is_file() else self.data
        version = {"bgmodel": __version__}
        return {"data": self.data, "trials": trials, **simulated, **said, **version}


def _circuits(models: Mapping[str, Model]) -> dict[str, str]:
    """Return the hash of the circuit of each model that has one."""
    made = {name: model.identity().get("circuit") for name, model in models.items()}
    return {name: each["sha256"] for name, each in made.items() if isinstance(each, dict)}
