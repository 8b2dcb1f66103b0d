"""Learning from reward: of a threshold, of a level of dopamine, or of what readings mean."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from bgmodel.bootstrap import FEWEST_TRIALS, check_trials, shown
from bgmodel.evidence import Evidence, needed_truth
from bgmodel.integrators.basal_ganglia import BasalGanglia
from bgmodel.integrators.sprt import threshold_from_posterior
from bgmodel.learning.critics import critic_of
from bgmodel.learning.deciders import FixedPoint, InCircuit, WeightLearner
from bgmodel.learning.dopamine import playable_levels
from bgmodel.learning.dopamine_learner import (
    CRITERION,
    LEVEL,
    LEVELS,
    CircuitLearned,
    learn_in_circuit,
)
from bgmodel.learning.feature_sources import UNITS as SENSORY
from bgmodel.learning.feature_sources import GaussianFeatures, tap_features
from bgmodel.learning.gap import LearnedGap, check_start, learn_gap, regret_of
from bgmodel.learning.learned_weights import LearnedWeights
from bgmodel.learning.reinforce import Learner
from bgmodel.learning.weight_rules import rule_of
from bgmodel.learning.weights import learn_weights
from bgmodel.support.checks import check_positive, whole
from bgmodel.support.processes import check_learning_memory, check_memory
from bgmodel.support.saved import Facts
from bgmodel.support.seeds import stream
from bgmodel.support.tables import Readable
from bgmodel.tactile.source import Source, Tactile, load_taps
from bgmodel.task import Drawn, Gaussian, Task
from bgmodel.trials.task_trials import EvidenceTable, read_once, trials_of
from circuits.anatomy import DEFAULT, load_circuit
from circuits.arrays import Array
from circuits.engines import engine_of
from circuits.errors import InputError, LearningWarning, require
from circuits.plots import PALETTE, one_panel, styled

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from bgmodel.learning.features import Features

THRESHOLD, DOPAMINE, WEIGHTS = "threshold", "dopamine", "weights"
"""What reward may move: the threshold of the test or of the circuit, the level of dopamine of a
circuit, or the weights that turn readings into evidence."""
XI, RUNS, TRIALS = 50.0, 10, 4000
"""Defaults: cost of an error (readings), runs, and trials from which a circuit learns."""
POSTERIOR = 0.68
"""Stopping posterior at a level of 1: 0.39 nats, which dopamine moves to 0.68 to 0.99."""
WEIGHTS_POSTERIOR, SCORED = 0.9, 2000
"""Stopping posterior while weights are learned, and number of trials on which they are scored."""
START_GAP = 0.5
"""Initial boundary separation, nats."""
READINGS = 20_000
"""Gaussian readings of each truth from which the test learns."""
UNITS = {THRESHOLD: "boundary separation (nats)", DOPAMINE: "level of dopamine",
         WEIGHTS: "slope (nats per exact nat)"}  # fmt: skip


@dataclass(frozen=True, repr=False)
class FromReward(Facts):
    """The result of learning from reward, scored on trials that were not used for learning."""

    what: str  # "threshold", "dopamine" or "weights"
    unit: str  # what the values are, with their unit
    learned: Array  # (runs,); for weights the slope against exact log-likelihoods
    best: float  # for weights 1, the slope of exact log-likelihoods
    # Rows "learned" and "start", columns value, low, high: excess over the least cost, per cent,
    # with 95 % intervals. The cost is mean time plus xi readings per error; for weights, the time
    # at 90 % correct.
    regrets: pd.DataFrame
    # The course: run, episode, mean, played, reward, dopamine (the reward prediction error); for
    # weights run, hypothesis, unit, weight.
    table: pd.DataFrame
    cautions: tuple[str, ...]  # what limits the result, usually empty
    details: CircuitLearned | LearnedWeights | LearnedGap
    scored: Features | None = None

    @property
    def regret(self) -> float:
        """Regret of the learned values, mean over runs, per cent."""
        return float(self.regrets.loc["learned", "value"])  # type: ignore[arg-type]

    def facts(self) -> dict[str, str]:
        """Return the learned quantity, the result in a sentence, and cautions."""
        facts = {"learned": self.unit, "result": self.verdict()}
        return facts | {f"caution {k}": text for k, text in enumerate(self.cautions, 1)}

    def verdict(self) -> str:
        """Return the learned value, the best one, and the regret, in one sentence."""
        texts = [
            shown(x, low, high, ".1f") if low < high or np.isnan(x) else f"{x:.1f}"
            for x, low, high in self.regrets.to_numpy()
        ]
        begun = f" (at the start {texts[1]} %)" if len(texts) > 1 else ""
        return (
            f"learned {self.unit} {self.learned.mean():.2f} (sd {self.learned.std():.2f} over "
            f"{len(self.learned)} runs), best {self.best:.2f}, regret {texts[0]} %{begun}"
            f"{self._as_posterior()}"
        )

    def _as_posterior(self) -> str:
        """Return the posterior that learned log odds of a criterion mean, as text, or ""."""
        if self.unit != CRITERION:
            return ""
        posterior = 1 / (1 + np.exp(-self.learned.mean()))
        return f"; learned criterion: a posterior of {posterior:.2f}"

    def summary(self) -> pd.DataFrame:
        """Return learned and best value, and regret, with 95 % intervals, one row each."""
        rows = {"learned": _over_runs(self.learned), "best": [self.best] * 3}
        rows |= {f"regret_percent, {name}": list(row) for name, row in self.regrets.iterrows()}
        table = pd.DataFrame.from_dict(rows, orient="index", columns=["value", "low", "high"])
        legend = f"learned, best: {self.unit}; low to high: 95 % interval{self._as_posterior()}"
        return Readable(table.rename_axis("measure").reset_index()).with_note(legend)

    def to_dataframe(self) -> pd.DataFrame:
        """Return ``table``."""
        return self.table

    @styled
    def plot(self) -> Figure:
        """Draw the course of learning (median and 10 to 90 % of runs) with the best value.

        Weights are drawn as learned against exact log-likelihoods of readings.
        """
        from bgmodel.plots import acquisition

        if isinstance(self.details, LearnedWeights) and self.scored is not None:
            return self.details.plot(self.scored)
        figure, ax = one_panel(None)
        every = self.table[self.table["episode"] % max(1, len(self.table) // 4000) == 0]
        wide = every.pivot(index="run", columns="episode", values="mean")
        acquisition(ax, wide, color=PALETTE[0], label="Median and 10 to 90 % of runs")
        ax.axhline(self.best, color="k", lw=0.8, ls="--", label="Best")
        ax.set(xlabel="Trial", ylabel=self.unit[0].upper() + self.unit[1:])
        ax.legend(frameon=False)
        return figure


def learn(
    task: Task,
    model: BasalGanglia | None = None,
    *,
    what: str | None = None,
    xi: float = XI,
    runs: int = RUNS,
    seed: int = 0,
    trials: int = TRIALS,
    start: float | None = None,
    posterior: float | None = None,
    learner: Learner | WeightLearner | None = None,
    taps: pd.DataFrame | str | Path | None = None,
    **more: Any,
) -> FromReward:
    """Let reward move a threshold, a level of dopamine, or the meaning of readings.

    Reward is ``-T - xi`` for an error and ``-T`` for a right choice, where T is the decision time
    in readings (Burguete, Griffith & Lepora 2023); for weights it is 1 or 0.

    Parameters
    ----------
    task : Task
        What is decided. The trials of a table, a ``bgmodel.trials.task_trials.EvidenceTable``, are
        halved for a circuit, which learns from one half; for the test its readings are drawn
        independently, as those of a task.
    model : BasalGanglia, optional
        The circuit that learns; without it, the optimal test does, or for dopamine the default
        circuit on the rate engine.
    what : str, optional
        ``"threshold"`` (of the test: its boundary separation; of a circuit: the posterior at which
        it decides, as log odds), ``"dopamine"`` (a level), or ``"weights"``; by default the
        threshold of the test, and the level of dopamine of a circuit.
    xi : float
        Cost of an error, readings.
    runs : int
        Number of independent runs.
    seed : int
        Seed of all random numbers.
    trials : int
        Number of trials from which a circuit learns, and of others on which it is scored.
    start : float, optional
        Initial value; by default 0.5 nats for the test, and that of the earliest decisions for a
        circuit.
    posterior : float, optional
        Posterior at which a circuit stops at a level of 1 (0.68 by default), or at which trials
        stop while weights are learned (0.9); not of a threshold, which is what is learned.
    learner : Learner or WeightLearner, optional
        Number of episodes, step sizes and exploration.
    taps : DataFrame or path, optional
        Decoded taps in place of those of a tactile task.
    **more
        ``levels`` of dopamine or log odds; ``rule``, ``critic`` and ``units`` of weights, as for
        ``learn_weights``.

    Raises
    ------
    ValueError
        For a task without what is learned, or a circuit that cannot decide it.

    Warns
    -----
    LearningWarning
        If a circuit ended worse than it began, at an end of its range, or has too few trials.
    """
    return planned(
        task, model, what=what, xi=xi, runs=runs, seed=seed, trials=trials, start=start,
        posterior=posterior, learner=learner, taps=taps, **more,
    )()  # fmt: skip


def planned(
    task: Task,
    model: BasalGanglia | None,
    *,
    what: str | None,
    xi: float,
    runs: int,
    seed: int,
    trials: int,
    start: float | None,
    posterior: float | None,
    learner: Any = None,
    taps: Any = None,
    **more: Any,
) -> Callable[[], FromReward]:
    """Check all arguments of ``learn``, and return the function that learns."""
    must = "must be a task, such as bg.SameDifferent() or, of a table, EvidenceTable(path)"
    require(isinstance(task, Task), "task", must, task)
    right = model is None or isinstance(model, BasalGanglia)
    require(right, "model", "must be a bg.BasalGanglia or None, for the test", model)
    what = what or (THRESHOLD if model is None else DOPAMINE)
    names = (THRESHOLD, DOPAMINE, WEIGHTS)
    require(what in names, "what", f"must be one of {', '.join(names)}", what)
    check_positive(xi=xi)
    whole("runs", runs, 1)
    stream(seed)
    if model is None and what == DOPAMINE:  # the test has none
        model = BasalGanglia(load_circuit(DEFAULT, task.channels), "rate", seed=seed)
    source = {"taps": taps} if taps is not None else {}
    if what == WEIGHTS:
        _know(more, "rule", "critic", "units")
        require(start is None, "start", "must be left out: weights start at 0", start)
        at = WEIGHTS_POSTERIOR if posterior is None else posterior
        learner = learner or WeightLearner()
        _check_weights(task, at, learner, runs, more)
        drawn: Any = task
        return partial(_weights, drawn, model, at, source, learner, runs=runs, seed=seed, **more)
    require(
        learner is None or isinstance(learner, Learner), "learner", "must be a Learner", learner
    )
    episodes = learner.episodes if isinstance(learner, Learner) else Learner.episodes
    check_learning_memory(runs, episodes)
    same: dict[str, Any] = {"xi": xi, "runs": runs, "seed": seed, "learner": learner}
    if model is None:
        _know(more)
        must = "must be left out: the test stops at the gap that it learns"
        require(posterior is None, "posterior", must, posterior)
        must = "must have 2 alternatives for the boundary separation of the test"
        require(task.channels == 2, "channels", must, task.channels)
        begun = START_GAP if start is None else float(start)
        check_start(begun, "start")
        return partial(_of_test, task, begun, source, **same)
    _know(more, "levels")
    must = "must be left out: it is what the circuit learns, and start is its log odds"
    require(posterior is None or what == DOPAMINE, "posterior", must, posterior)
    engine = engine_of(model.engine)
    require(engine.timed, "engine", "must be one with times, such as rate", engine.id)
    model.circuit.check_nats("a stopping posterior")
    levels: Any = more.get("levels")
    many = levels if isinstance(levels, int) else max(LEVELS, np.size(levels))
    require(many >= 2, "levels", "must be >= 2", many)
    numbers = 3 * 8.0 * many * trials
    check_memory(numbers, f"{many} values for each of {trials} trials")
    return partial(_of_circuit, task, model, what, trials, start, posterior, source, **same, **more)


def _check_weights(
    task: Task, posterior: float, learner: Any, runs: int, more: Mapping[str, Any]
) -> None:
    """Raise ValueError for weights that cannot be learned."""
    if not isinstance(task, Gaussian | Tactile):
        raise InputError.of("task", "must be drawn, for sensory units to see", task.text)
    must = "must be a WeightLearner"
    require(isinstance(learner, WeightLearner), "learner", must, learner)
    rule, critic = rule_of(more.get("rule", "confidence")), more.get("critic")
    critic_of(rule.critic if critic is None else critic)
    units = whole("units", more.get("units", SENSORY), 2)
    chance = 1 / task.channels
    must = f"must be above {chance:.3g}, chance, and below 1"
    require(chance < posterior < 1, "posterior", must, posterior)
    numbers = 8.0 * runs * (3 * learner.trials + 300.0 * task.t_max * units)
    check_memory(numbers, f"{runs} runs of {learner.trials} trials")


def _know(more: dict[str, Any], *names: str) -> None:
    known = f", where {', '.join(names)} may be given" if names else ""
    for name in more:
        if name not in names:
            raise InputError(f"{name} has no effect here{known}", name)


def _of_test(task: Task, start: float, source: dict[str, Any], **same: Any) -> FromReward:
    """Learn the boundary separation of the test."""
    readings = _readings(task, source, same["seed"])
    main = getattr(task, "main", "")  # a table has none
    name = (getattr(task, main, 0.0), getattr(task, "fold", 0))
    gap = learn_gap(readings, name=name, start_separation=start, t_max=task.t_max, **same)
    at_start = regret_of(np.array([start]), readings, gap.optimum, same["xi"], task.t_max)
    rows = {
        "learned": _over_runs(100 * gap.regret),
        "start": [100 * float(at_start[0])] * 3,  # exact
    }
    return FromReward(
        THRESHOLD, UNITS[THRESHOLD], gap.learned.learned, gap.optimum.boundary_separation,
        pd.DataFrame.from_dict(rows, orient="index", columns=["value", "low", "high"]),
        gap.learned.to_dataframe(), (), gap,
    )  # fmt: skip


def _readings(task: Task, source: dict[str, Any], seed: int) -> Source:
    """Return all readings of a task with two alternatives, with their log-likelihoods."""
    if isinstance(task, Tactile):
        return task.source(**source)
    if isinstance(task, EvidenceTable):
        evidence, where = read_once(task).evidence, f"in {task.text}"
    else:
        assert isinstance(task, Gaussian)
        drawn = replace(task, trials=2 * READINGS, t_max=1)
        evidence, where = (
            drawn.evidence(seed=stream(seed, "readings")),
            f"with a d' of {task.d_prime:g}",
        )
    truth, there = needed_truth(evidence), np.arange(evidence.steps) < evidence.readings[:, None]
    parts = [evidence.log_likelihood[there & (truth == k)[:, None]] for k in range(2)]
    require(all(map(len, parts)), "evidence", "must have trials of both truths", task.text)
    return Source(parts, ("1", "2"), None, where)  # type: ignore[arg-type]


def _of_circuit(
    task: Task,
    model: BasalGanglia,
    what: str,
    trials: int,
    start: float | None,
    posterior: float | None,
    source: dict[str, Any],
    *,
    levels: Any = None,
    **same: Any,
) -> FromReward:
    """Learn the level of dopamine of a circuit, or the posterior at which it decides."""
    evidence, fresh = _learned_and_scored(task, trials, source, same["seed"])
    options: dict[str, Any] = {"what": CRITERION, "levels": levels}
    if what == DOPAMINE:
        at = POSTERIOR if posterior is None else posterior
        nats = float(threshold_from_posterior(at, evidence.hypotheses))
        model = model.adapted_to(evidence)
        if levels is None or isinstance(levels, int):
            levels = playable_levels(model, LEVELS if levels is None else levels, nats)
        options = {"what": LEVEL, "levels": levels, "threshold_nats": nats}
    if levels is not None:
        ends = (float(np.min(levels)), float(np.max(levels)))
        inside = start is None or ends[0] <= start <= ends[1]
        must = (
            f"must lie where {model.circuit.name} decides by evidence, {ends[0]:.3f}..{ends[1]:.3f}"
        )
        require(inside, "start", must, start)
    learned = learn_in_circuit(model, evidence, fresh, start=start, **options, **same)
    return FromReward(
        what, UNITS[DOPAMINE] if what == DOPAMINE else CRITERION, learned.learned.learned,
        learned.fresh.best(same["xi"])[0], learned.regrets.loc[["learned", "start"]],
        learned.learned.to_dataframe(), tuple(learned.cautions), learned,
    )  # fmt: skip


def _learned_and_scored(
    task: Task, trials: int, source: dict[str, Any], seed: int
) -> tuple[Evidence, Evidence]:
    """Return the trials for learning, and others on which regret is measured."""
    if not isinstance(task, EvidenceTable):
        check_trials(trials)
        asked = task.changed(trials=trials)
        return (
            trials_of(asked, seed, "learn", **source).evidence,
            trials_of(asked, seed, "learn, scored", **source).evidence,
        )
    evidence = trials_of(task, seed, "learn").evidence
    must = f"must hold {FEWEST_TRIALS} trials or more: half are scored"
    require(evidence.trials >= FEWEST_TRIALS, "evidence", must, evidence.trials)
    # Every second trial of each truth: a table may list its truths in turn.
    order = np.argsort(needed_truth(evidence), kind="stable")
    second = np.argsort(order, kind="stable") % 2 == 1
    return evidence[~second], evidence[second]


def _weights(
    task: Drawn,
    model: BasalGanglia | None,
    at: float,
    source: dict[str, Any],
    learner: WeightLearner,
    *,
    runs: int,
    seed: int,
    units: int = SENSORY,
    **more: Any,
) -> FromReward:
    """Learn what readings mean; compare with the exact likelihoods."""
    learns, scores = _features(task, source, units)
    decider = FixedPoint(criterion=at) if model is None else InCircuit(model, at)
    learned = learn_weights(learns, seed=seed, learner=learner, runs=runs, decider=decider, **more)
    test = scores(SCORED, rng=stream(seed, "learn-weights", "scored"))
    percent = 100 * (learned.relative_time(test, 0.9) - 1)
    regrets = pd.DataFrame([_over_runs(percent)], ["learned"], ["value", "low", "high"])
    slope = learned.calibration(test).slope
    table = learned.to_dataframe()
    few = f"{np.isnan(percent).sum()} of {runs} runs do not reach 90 % correct: regret is unknown"
    cautions = (few,) if np.isnan(percent).any() else ()
    for caution in cautions:
        LearningWarning.warn(caution)
    return FromReward(WEIGHTS, UNITS[WEIGHTS], slope, 1.0, regrets, table, cautions, learned, test)


def _features(
    task: Drawn, source: dict[str, Any], units: int
) -> tuple[Any, Callable[..., Features]]:
    """Return the features for learning, and a function that draws those of trials to score."""
    timing: dict[str, Any] = {"t_max": task.t_max, "step_ms": task.step_ms}
    if isinstance(task, Gaussian):
        drawn = GaussianFeatures(task.d_prime, task.channels, units, **timing)
        return drawn, drawn.draw
    assert isinstance(task, Tactile)
    taps = load_taps(source.get("taps", task.taps))
    learns, scores = tap_features(taps, task, units=units, fold=task.fold, **timing)
    return learns, scores.draw


def _over_runs(values: Array) -> list[float]:
    """Return the mean over runs and its 95 % interval, by Student's t: runs are few."""
    # Importing scipy.special takes long: only when runs have been made.
    from scipy.special import stdtrit

    mean, runs = float(values.mean()), len(values)
    error = float(values.std(ddof=1)) / np.sqrt(runs) if runs > 1 else np.nan
    half = float(stdtrit(runs - 1, 0.975)) * error if runs > 1 else np.nan
    return [mean, mean - half, mean + half]
