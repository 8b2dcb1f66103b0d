"""Experiments: a control and a manipulation on the same evidence, with predictions to test.

An experiment is a short TOML file. It states the published result, its counterpart in the circuit
and, before anything is run, the direction of each measure's change and the least that counts.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from bgmodel.bootstrap import check_trials, interval, weights_of
from bgmodel.conditions import seen_from
from bgmodel.deciding.measures import OF_DECIDED, OF_STOP, Behaviour
from bgmodel.deciding.tradeoff import decides_without_evidence
from bgmodel.experiments.expected import FEWEST_DECIDED, PERCENT, RELATIVE, forest
from bgmodel.experiments.outcomes import beside_published, outcomes, page
from bgmodel.experiments.record import (
    CONDITIONS,
    MANY_MISSED,
    UNCHANGED,
    ExperimentRecord,
    uncalibrated,
    unchanged,
)
from bgmodel.integrators.basal_ganglia import BasalGanglia
from bgmodel.support import toml_files
from bgmodel.support.checks import path_of
from bgmodel.support.saved import Facts
from bgmodel.support.tables import Readable
from bgmodel.trials.named_evidence import NamedEvidence, trial_table
from circuits.declaration.table_writer import digest
from circuits.errors import CalibrationWarning, DeadlineWarning, EditWarning, InputError
from circuits.store import Latest

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SHIPPED = Path(__file__).with_name("shipped")


@dataclass(frozen=True, kw_only=True)
class Experiment(ExperimentRecord):
    """A control, a manipulation and predictions; all other settings are shared.

    ``template()`` returns a whole file, without the optional tables ``[control]`` and ``[stop]``
    (stop signals).
    """

    @staticmethod
    def template() -> str:
        """Return a whole file of an experiment, to start from, as text."""
        return shipped_text("stn_lesion_partial")

    @classmethod
    def from_toml(cls, file: str | Path) -> Experiment:
        """Read an experiment from a TOML file, or an included one by its name.

        Raises
        ------
        ValueError
            If the file is invalid; the message names the key, what is allowed and what was given.
        """
        path = path_of(file, "file")
        if path.suffix == ".toml":
            return seen_from(path.parent, toml_files.read(path, cls))
        inside = SHIPPED / f"{file}.toml"
        if not inside.is_file():
            names = ", ".join(shipped_names())
            raise InputError(
                f"an experiment is a .toml file or one of {names}; got {str(file)!r}", "file"
            )
        return toml_files.read(inside, cls)

    @classmethod
    def from_text(cls, text: str, name: str = "the text") -> Experiment:
        """Read an experiment from the text of a TOML file.

        Parameters
        ----------
        text : str
            The text; its paths are relative to the current folder.
        name : str
            What the text is called in errors.

        Raises
        ------
        ValueError
            As ``from_toml``.
        """
        return toml_files.read_text(text, cls, name)

    def run(
        self,
        *,
        workers: int = 1,
        named: NamedEvidence | None = None,
        kept: Latest | None = None,
    ) -> Outcome:
        """Run control and manipulation on the same evidence with the same noise.

        Parameters
        ----------
        workers : int
            Number of threads, for engines that can use several; it does not affect results.
        named : NamedEvidence, optional
            The result of ``given()``, to avoid computing it twice.
        kept : Latest, optional
            What earlier runs have computed already; results of this run are added. For programs
            that edit the manipulation again and again, while the control stays.

        Raises
        ------
        ValueError
            If an edit does not fit the circuit, the control decides without evidence or against
            it, a posterior is outside the range of the read-out, or there are too few trials.

        Warns
        -----
        UserWarning
            If evidence leaves the circuit's range, noise alone crosses the threshold, many trials
            are missed (undecided at the deadline), the manipulation decides against the evidence,
            no decision differs between the conditions, or posteriors at the decision differ from
            the proportion correct.
        """
        named = named or self.given()
        evidence = named.evidence
        check_trials(evidence.trials)
        control, manipulation = self.conditions
        manipulation.check(control)
        both = {"control": control, "manipulation": manipulation}
        models = [
            condition.model(evidence.hypotheses, workers=workers, rates=False).adapted_to(evidence)
            for condition in both.values()
        ]
        models[0].warn_beyond_range(evidence)
        models[0].warn_of_noise(control.threshold_nats)
        # Without the argument, keys are None and every condition is computed.
        memory = Latest(len(both)) if kept is None else kept
        weights = weights_of(evidence.trials, self.seed)
        per_condition: list[dict[str, Any]] = []
        trials, go = [], 0
        for (name, condition), model in zip(both.items(), models, strict=True):
            # A circuit's file may have changed since.
            key = None if kept is None else (condition, self.truth, digest(model.circuit))
            behave = partial(condition.behaviour, model, evidence)
            behaviour = memory.once("behaviour", key, behave)
            _check_decided(name, behaviour, self.waited_ms)
            per_condition.append(memory.once("measures", key, partial(behaviour.measures, weights)))
            about = f"{model.circuit.name} {model.engine}"
            decided = behaviour.in_time()
            table = trial_table(decided, named, seed=self.seed, model=about, condition=name)
            trials.append(table.assign(**behaviour.columns()))
            go = int(behaviour.go.sum())
        measures = _table(per_condition, go, evidence.trials - go)
        if unchanged(measures):
            EditWarning.warn(
                f"{UNCHANGED}: the manipulation has no effect on the {self.engine} engine, or none "
                "within a trial; check its units and times"
            )
        if warning := uncalibrated(self, measures):
            CalibrationWarning.warn(warning)
        all_trials = pd.concat(trials, ignore_index=True)
        return Outcome(self, named, tuple(models), measures, all_trials)


def shipped() -> dict[str, Experiment]:
    """Return the included experiments by the names of their files."""
    return {name: Experiment.from_toml(name) for name in shipped_names()}


def shipped_text(name: str) -> str:
    """Return the file of an included experiment as text."""
    return (SHIPPED / f"{name}.toml").read_text(encoding="utf-8")


def shipped_names() -> list[str]:
    """Return the names of the included experiments."""
    return sorted(path.stem for path in SHIPPED.glob("*.toml"))


@dataclass(frozen=True, repr=False)
class Outcome(Facts):
    """The results of an experiment.

    Parameters
    ----------
    experiment : Experiment
        The experiment.
    given : NamedEvidence
        Trials of both conditions.
    models : tuple of BasalGanglia
        Control and manipulation.
    measures : DataFrame
        One row per condition ("control", "manipulation", and "change", the second minus the first)
        and measure of ``MEASURES`` (and of ``OF_STOP`` with stop signals): condition, measure,
        value, low, high, trials. Low and high are
        the 95 % interval, a bootstrap over trials that keeps the two conditions of a trial
        together; trials is the number of trials behind the value, for a change the smaller of two.
        Measures of decisions also have a condition "percent", the change in per cent of the
        control's value.
    trials : DataFrame
        One row per trial and condition, as from ``named.trial_table``, and anticipatory: whether
        the foreperiod before it, simulated separately, ended in a response; with stop signals also
        ssd_ms, the stop-signal delay.
    """

    experiment: Experiment
    given: NamedEvidence
    models: tuple[BasalGanglia, ...]
    measures: pd.DataFrame
    trials: pd.DataFrame

    def facts(self) -> dict[str, str]:
        """Return the number of trials, the circuit, and each condition's accuracy and mean time."""
        model, values = self.models[0], self.measures.set_index(["condition", "measure"])["value"]
        facts = {
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
            facts[condition] = f"accuracy {accuracy:{sign}.3f} in {mean_ms:{sign}.0f} ms"
        return facts

    def summary(self) -> pd.DataFrame:
        """Return a readable table of each measure in both conditions, and of its change."""
        shown = self.measures[self.measures["condition"].isin(CONDITIONS)]
        table: dict[str, pd.Series] = {}
        for name in CONDITIONS:
            rows = shown[shown["condition"] == name].set_index("measure")
            table |= {name: rows["value"], f"{name}_low": rows["low"], f"{name}_high": rows["high"]}
        return Readable(table).round(3)

    def verdicts(self) -> pd.DataFrame:
        """Return each prediction with the observed change, the verdict and its reason."""
        return Readable(outcomes(self.experiment, self.measures))

    def published(self) -> pd.DataFrame:
        """Return each published effect with the corresponding effect in the circuit."""
        return Readable(beside_published(self.experiment, self.measures))

    def rows(self) -> pd.DataFrame:
        """Return the measures, with the verdict of each prediction and each published effect."""
        kept = ["condition", "measure", "direction", "at_least", "outcome", "reason"]
        verdicts = self.verdicts().assign(condition="change")[kept]
        rows = self.measures.merge(verdicts, how="left", on=["condition", "measure"])
        if not self.experiment.effects:
            return rows
        published = self.published().drop(columns=["value", "low", "high"])
        return rows.merge(published, how="left", on=["condition", "measure"])

    def text(self) -> str:
        """Return the report that the command prints."""
        model = self.models[0]
        return page(replace(self.experiment, gain=model.gain), self.measures)

    def to_dataframe(self) -> pd.DataFrame:
        """Return ``measures``."""
        return self.measures

    def plot(self) -> Figure:
        """Draw the change of each measure with its 95 % interval, as a forest plot.

        Intervals are from a bootstrap over trials that keeps both conditions of a trial together. A
        grey box is the range of changes that agree with a prediction. The marker's shape and a word
        on the right give the verdict; between them are the values of both conditions. Published
        effects in the unit of the measure are shown as diamonds.
        """
        trials = self.given.evidence.trials
        title = (
            f"{self.experiment.name}: manipulation minus control with 95 % intervals, "
            f"{trials} trials per condition"
        )
        return forest(self.measures, self.verdicts(), self.published(), title)


def _table(per_condition: list[dict[str, Any]], trials: int, stops: int) -> pd.DataFrame:
    """Return the measures of both conditions and of their change as a table."""
    control, manipulation = per_condition
    change = {name: manipulation[name] - control[name] for name in control}
    # The change in per cent is undefined for a control of 0.
    of = {name: np.where(control[name] == 0, np.nan, control[name]) for name in RELATIVE}
    percent = {name: 100 * change[name] / of[name] for name in RELATIVE}
    counts = [int(values["decided"][0]) for values in per_condition]
    behind = dict.fromkeys(OF_STOP, stops)
    rows = [
        (
            condition, name, *interval(values[name]),
            decided if name in OF_DECIDED else behind.get(name, trials),
        )
        for condition, values, decided in zip(
            (*CONDITIONS, PERCENT),
            (control, manipulation, change, percent),
            (*counts, min(counts), min(counts)),
            strict=True,
        )
        for name in values
    ]  # fmt: skip
    columns = ["condition", "measure", "value", "low", "high", "trials"]
    return pd.DataFrame(rows, columns=columns)


def _check_decided(condition: str, behaviour: Behaviour, foreperiod_ms: float) -> None:
    """Refuse a control that does not decide by evidence; warn if many trials are missed.

    The behaviour of a manipulated circuit is an outcome and is never refused.
    """
    premature, waited = behaviour.decision.premature.mean(), behaviour.anticipatory.mean()
    missed = behaviour.missed[behaviour.go]
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
            "times and the mean posterior refer to these only; give more readings (t_max) or "
            "a lower posterior"
        )
