"""Experiments: a control and a manipulation on the same evidence, held to a prediction.

An experiment is a short TOML file. It says what was published, what stands for it in the circuit,
and, before anything is run, which measure goes which way by how much at least.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from importlib.resources import files as resources
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from bgmodel.bootstrap import RESAMPLES, check_trials, interval, resampled
from bgmodel.deciding.measures import MEASURES, OF_DECIDED, Behaviour
from bgmodel.deciding.tradeoff import decides_without_evidence
from bgmodel.experiments.outcomes import beside_published, outcomes, page
from bgmodel.experiments.predictions import FEWEST_DECIDED, PERCENT, RELATIVE
from bgmodel.experiments.record import (
    CONDITIONS,
    MANY_MISSED,
    UNCHANGED,
    ExperimentRecord,
    uncalibrated,
    unchanged,
)
from bgmodel.integrators.basal_ganglia import BasalGanglia
from bgmodel.stimuli import seen_from
from bgmodel.support import toml_files
from bgmodel.support.checks import path_of
from bgmodel.support.reprs import Facts
from bgmodel.support.seeds import stream
from bgmodel.tables.trials import Trials, trial_table
from circuits.errors import CalibrationWarning, DeadlineWarning, EditWarning, InputError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from matplotlib.axes import Axes

SHIPPED = resources("bgmodel.experiments") / "shipped"


@dataclass(frozen=True, kw_only=True)
class Experiment(ExperimentRecord):
    """A control, a manipulation and what it should do; both have the rest in common.

    As a file::

        name = "STN lesion"
        note = "why the manipulation stands for what was done"
        circuit = "macaque"

        [task]
        d_prime = 0.5
        trials = 1000
        t_max = 120

        [control]                    # may be left out
        edits = []

        [manipulation]
        edits = ["lesion STN 10%", "dopamine 0.9"]

        [[predictions]]              # before the run; may be left out
        measure = "accuracy"
        direction = "down"           # "up", or "none": within +-at_least
        at_least = 0.01              # in the measure's unit: the least change that counts

    ``bgmodel experiment NAME --show`` prints one that is shipped.
    """

    @classmethod
    def from_toml(cls, file: str | Path) -> Experiment:
        """Read an experiment: the path of a TOML file, or the name of one that is shipped.

        Raises
        ------
        ValueError
            One sentence with the key, what was given and what is allowed.
        """
        path = path_of(file, "file")
        if path.suffix == ".toml":
            return seen_from(path.parent, toml_files.read(path, cls))
        inside = SHIPPED / f"{file}.toml"
        if not inside.is_file():
            names = ", ".join(_names())
            raise InputError(
                f"an experiment is a .toml file or one of {names}; got {str(file)!r}", "file"
            )
        return toml_files.read(Path(str(inside)), cls)

    def run(self, *, workers: int = 1, given: Trials | None = None) -> Outcome:
        """Run control and manipulation on the same evidence with the same noise.

        Parameters
        ----------
        workers : int
            Threads of the engines that can use several; the results do not depend on them.
        given : Trials, optional
            What ``given()`` returned, where that was asked already.

        Raises
        ------
        ValueError
            If an edit does not fit the circuit, the control decides without evidence or against
            it, a posterior lies beyond what OUT reads, or there are too few trials.

        Warns
        -----
        UserWarning
            If evidence leaves the circuit's range, noise alone crosses the threshold, many trials
            are missed, the manipulation decides against the evidence, no decision differs between
            the conditions, or posteriors at the decision are not the share of right choices.
        """
        given = given or self.given()
        evidence = given.evidence
        check_trials(evidence.trials)
        control, manipulation = self.conditions
        manipulation.check(control)
        both = {"control": control, "manipulation": manipulation}
        models = [
            condition.model(evidence.hypotheses, workers=workers, rates=False)
            for condition in both.values()
        ]
        models[0].warn_beyond_range(evidence)
        models[0].warn_of_noise(control.threshold_nats)
        weights = resampled(evidence.trials, RESAMPLES, stream(self.seed, "bootstrap"))
        found: list[dict[str, Any]] = []
        trials = []
        for (name, condition), model in zip(both.items(), models, strict=True):
            behaviour = condition.behaviour(model, evidence)
            _check_decided(name, behaviour, self.foreperiod_ms)
            found.append(behaviour.measures(weights))
            about = f"{model.circuit.name} {model.engine}"
            decided = behaviour.in_time()
            table = trial_table(decided, given, seed=self.seed, model=about, condition=name)
            trials.append(table.assign(anticipatory=behaviour.anticipatory))
        measures = _table(found, evidence.trials)
        if unchanged(measures):
            EditWarning.warn(
                f"{UNCHANGED}: the manipulation says nothing to the {self.engine} engine, or "
                "nothing while a trial lasts; look at its units and times"
            )
        if said := uncalibrated(self, measures):
            CalibrationWarning.warn(said)
        whole = pd.concat(trials, ignore_index=True)
        return Outcome(self, given, tuple(models), measures, whole)


def shipped() -> dict[str, Experiment]:
    """Return the experiments that come with the package, by the names of their files."""
    return {name: Experiment.from_toml(name) for name in _names()}


def shipped_text(name: str) -> str:
    """Return the file of an experiment that is shipped, as text."""
    return (SHIPPED / f"{name}.toml").read_text(encoding="utf-8")


def _names() -> list[str]:
    return sorted(Path(entry.name).stem for entry in SHIPPED.iterdir())


@dataclass(frozen=True, repr=False)
class Outcome(Facts):
    """What came of an experiment.

    Parameters
    ----------
    experiment : Experiment
        What was run.
    given : Trials
        What both conditions were given.
    models : tuple of BasalGanglia
        Control and manipulation.
    measures : DataFrame
        One row per condition ("control", "manipulation", and "change", the second minus the first)
        and measure of ``MEASURES``: condition, measure, value, low, high, trials. Low and high are
        the 95 % interval, a bootstrap over trials that keeps the two conditions of a trial
        together; trials is the number that the value rests on, of a change the smaller one. For
        measures of decisions a condition "percent" too, the change over the control's value.
    trials : DataFrame
        One row per trial and condition, as from ``tables.trial_table``, and anticipatory: whether
        the foreperiod before it, a run of its own, ended in a response.
    """

    experiment: Experiment
    given: Trials
    models: tuple[BasalGanglia, ...]
    measures: pd.DataFrame
    trials: pd.DataFrame

    def facts(self) -> dict[str, str]:
        """Return trials, circuit, and accuracy and mean time of each condition."""
        model, values = self.models[0], self.measures.set_index(["condition", "measure"])["value"]
        found = {
            "trials": f"{self.given.evidence.trials} per condition",
            "circuit": model.circuit.name,
            "engine": model.engine.id,
            "gain": f"{model.gain:g}",
            "posterior": self.experiment.stopping,
            "seed": f"{self.experiment.seed}",
        }
        for condition in CONDITIONS:
            sign = "+" if condition == "change" else ""
            accuracy, mean_ms = values[condition, "accuracy"], values[condition, "mean_ms"]
            found[condition] = f"accuracy {accuracy:{sign}.3f} in {mean_ms:{sign}.0f} ms"
        return found

    def summary(self) -> pd.DataFrame:
        """Return each measure of control, manipulation and their change, for a reader."""
        shown = self.measures[self.measures["condition"].isin(CONDITIONS)]
        found: dict[str, pd.Series] = {}
        for name in CONDITIONS:
            rows = shown[shown["condition"] == name].set_index("measure").loc[list(MEASURES)]
            found |= {name: rows["value"], f"{name}_low": rows["low"], f"{name}_high": rows["high"]}
        return pd.DataFrame(found).round(3)

    def verdicts(self) -> pd.DataFrame:
        """Return each prediction with the change that was found, the verdict and its reason."""
        return outcomes(self.experiment, self.measures)

    def published(self) -> pd.DataFrame:
        """Return each published effect with the circuit's."""
        return beside_published(self.experiment, self.measures)

    def text(self) -> str:
        """Return the report that the command prints."""
        model = self.models[0]
        return page(replace(self.experiment, gain=model.gain), self.measures)

    def to_dataframe(self) -> pd.DataFrame:
        """Return ``measures``."""
        return self.measures

    def plot(self, ax: Axes | Sequence[Axes] | None = None) -> Any:
        """Draw each measure of both conditions with its 95 % interval.

        Parameters
        ----------
        ax : Axes, one per measure that is known, optional
            Drawn on; a new figure unless given.

        Returns
        -------
        array of Axes
            One per measure.
        """
        from bgmodel.plots import conditions

        return conditions(self.measures[self.measures["condition"].isin(CONDITIONS[:2])], ax)


def _table(found: list[dict[str, Any]], trials: int) -> pd.DataFrame:
    """Return the measures of both conditions and of their change as a table."""
    control, manipulation = found
    change = {name: manipulation[name] - control[name] for name in MEASURES}
    # A control that is at 0 has no change in per cent.
    of = {name: np.where(control[name] == 0, np.nan, control[name]) for name in RELATIVE}
    percent = {name: 100 * change[name] / of[name] for name in RELATIVE}
    counts = [int(values["decided"][0]) for values in found]
    rows = [
        (condition, name, *interval(values[name]), decided if name in OF_DECIDED else trials)
        for condition, values, decided in zip(
            (*CONDITIONS, PERCENT),
            (control, manipulation, change, percent),
            (*counts, min(counts), min(counts)),
            strict=True,
        )
        for name in MEASURES
        if name in values
    ]
    columns = ["condition", "measure", "value", "low", "high", "trials"]
    return pd.DataFrame(rows, columns=columns)


def _check_decided(condition: str, behaviour: Behaviour, foreperiod_ms: float) -> None:
    """Refuse a control that does not decide by its evidence; warn where many trials are missed.

    What a manipulated circuit does is an outcome, and none of these refuses it.
    """
    premature, waited = behaviour.decision.premature.mean(), behaviour.anticipatory.mean()
    missed = behaviour.decision.forced
    if condition == "control" and decides_without_evidence(premature, waited, foreperiod_ms):
        raise ValueError(
            f"the control decides without evidence: {premature:.0%} of its trials before the first "
            f"reading, {waited:.0%} of foreperiods of {foreperiod_ms:g} ms end in a response"
        )
    if against := behaviour.against_evidence():
        if condition == "control":
            raise ValueError(f"the control's {against}")
        CalibrationWarning.warn(f"the {condition}'s {against}")
    decided = int((~missed).sum())
    if condition == "control" and decided < FEWEST_DECIDED:
        raise ValueError(
            f"the control decides in time in {decided} of {len(missed)} trials, at least "
            f"{FEWEST_DECIDED} are needed"
        )
    if missed.mean() > MANY_MISSED:
        DeadlineWarning.warn(
            f"the {condition} decides in time in {decided} of {len(missed)} trials: accuracy, "
            "times and the mean posterior are those of these alone; give more readings (t_max) or "
            "a lower posterior"
        )
