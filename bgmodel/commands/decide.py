"""Commands that decide by the sequential test, compare a circuit with it, and learn from reward."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Annotated, Any, Literal

import pandas as pd

from bgmodel.bootstrap import check_trials
from bgmodel.commands.options import FLAT, MANY, OFF, Edited, Workers, like, record_of, task
from bgmodel.commands.output import (
    Output,
    bar,
    check_idle,
    made_with,
    options_of,
    say,
    say_before,
    say_of_edits,
)
from bgmodel.comparison import compare as comparing
from bgmodel.comparison.matched import checked_accuracies
from bgmodel.comparison.page import page, verdicts
from bgmodel.conditions import Setup
from bgmodel.integrators.at_thresholds import sample_ms
from bgmodel.integrators.basal_ganglia import BasalGanglia
from bgmodel.integrators.baselines import BASELINES, baselines_on
from bgmodel.integrators.sprt import Msprt, Sprt, threshold_from_posterior
from bgmodel.learning import from_reward
from bgmodel.learning.deciders import WeightLearner
from bgmodel.learning.dopamine_learner import LEVELS, CircuitLearned
from bgmodel.learning.from_reward import DOPAMINE, WEIGHTS, planned
from bgmodel.learning.reinforce import Learner
from bgmodel.names import MACAQUE, CircuitName, EngineName
from bgmodel.support.checks import whole
from bgmodel.support.files import recorded
from bgmodel.support.processes import check_evidence_memory
from bgmodel.tactile.task import SameDifferent
from bgmodel.task import Gaussian, Task
from bgmodel.trials.named_evidence import trial_table
from bgmodel.trials.task_trials import trials_of
from circuits.declaration.edits import Edits
from circuits.declaration.table import NATS
from circuits.declaration.table_writer import identity
from circuits.errors import InputError, LearningWarning, collected, quiet, require

SEPARATION_NATS = 4.0
"""Default boundary separation, nats."""
TAPPED = SameDifferent(trials=1000, t_max=30, step_ms=500.0)
"""Default evidence: taps of the paper's task, one every half second."""


def decide(
    *,
    task: Annotated[Task, task(TAPPED)] = TAPPED,
    boundary_separation: float | None = None,
    posterior: float | None = None,
    prior: Annotated[tuple[float, ...] | None, MANY] = None,
    forced: Annotated[bool, OFF] = True,
    seed: int = 0,
    output: Annotated[Output, FLAT] = Output(),  # noqa: B008
) -> None:
    """Decide by the sequential test, on tactile evidence or on your own evidence table.

    A table has one row per reading with the columns trial, step, `ll_<hypothesis>` (natural log
    likelihoods; two or more such columns) and, if known, truth. Trials may differ in length: each
    is forced, or left undecided, at its own last reading. Other columns are kept in the result.

    Examples: bgmodel decide --task period_mm=2 --boundary-separation 4 --save decisions.csv;
    bgmodel decide --task mine.csv --posterior 0.95

    Parameters
    ----------
    boundary_separation
        Boundary separation (gap) of the SPRT, nats (two hypotheses); 4 unless posterior is given.
    posterior
        Posterior probability at which the MSPRT stops, instead of a boundary separation.
    prior
        Prior probabilities; equal by default.
    forced
        Whether the leading hypothesis is chosen at the last reading of an undecided trial.
    seed
        Seed of all random numbers.
    """
    output.check(task=task)
    given = {"boundary_separation": boundary_separation, "posterior": posterior}
    whole("seed", seed, 0)
    if posterior is not None and boundary_separation is not None:
        reason = "boundary_separation and posterior both set the threshold: give one of them"
        raise InputError(reason, "boundary_separation")
    separation = SEPARATION_NATS if boundary_separation is None else boundary_separation
    if posterior is None:
        given["boundary_separation"] = separation
    check_evidence_memory(task.trials, task.t_max, task.channels)
    test: Sprt | Msprt = Sprt() if posterior is None else Msprt()
    if posterior is not None:
        threshold = float(threshold_from_posterior(posterior, task.channels))
    else:
        threshold = float(Sprt.threshold(separation))
        must = "is for 2 alternatives: give --posterior"
        require(task.channels == 2, "boundary_separation", must, task.channels)
    trials = trials_of(task, seed, "decide", prior=prior)
    drawn = seed if task.file is None else None
    if drawn is None:
        output.note(trials.summary())
    decision = test.decide(trials.evidence, threshold, forced=forced)
    ((level, nats),) = ((name, value) for name, value in given.items() if value is not None)
    about = f"{'sprt' if posterior is None else 'msprt'} {level}={nats:g}"
    result = trial_table(decision, trials, seed=drawn, model=about)
    known = result["correct"].dropna() if "correct" in result else pd.Series(dtype=float)
    facts = {
        "trials": len(result),
        "accuracy": float(known.astype(float).mean()) if len(known) else None,
        "forced": int(result["forced"].sum()),
        "undecided": int(result["undecided"].sum()),
    }
    scored = "no trial decided" if facts["undecided"] == len(result) else "no truth given"
    if len(known):
        scored = f"accuracy {facts['accuracy']:.3f}{'' if forced else ' of those decided'}"
    text = (f"{about}: {len(result)} trials, {scored}, mean readings {result['steps'].mean():.2f}, "
            f"forced {facts['forced']}, undecided {facts['undecided']}")  # fmt: skip
    output.show(text, result, **facts)
    behind = options_of(task=task, prior=prior, forced=forced, **given)
    output.write(result, drawn, command=behind)
    output.draw(decision.plot)


MANY_TRIALS = Gaussian(trials=1000, t_max=110)
"""Default task."""


@like(comparing.compare, "accuracies", "noise_ceiling", accuracies=Sequence[float])
def compare(
    *,
    setup: Annotated[Setup, FLAT] = Setup(),  # noqa: B008
    task: Annotated[Task, task(MANY_TRIALS)] = MANY_TRIALS,
    workers: Workers = 2,
    output: Annotated[Output, FLAT] = Output(),  # noqa: B008
    **options: Any,
) -> None:
    """Compare decisions of a circuit and of the MSPRT on the same evidence, trial by trial.

    Thresholds are matched to equal accuracy. The references are the MSPRT at the circuit's gain and
    at full gain. A decoder of the circuit's cortical spikes and baseline models are compared too,
    and each agreement comes with its chance level, from shuffled trials. For an edited circuit, the
    difference of each measure from the intact circuit is reported too.

    Examples: bgmodel compare --task same-different period_mm=1.5 --noise-ceiling --plot a.png;
    bgmodel compare --task channels=4 --edits "clamp GPe" --save agreement.csv
    """
    output.check(setup=setup, task=task)
    trials = trials_of(task, setup.seed, "compare")
    evidence = trials.evidence
    if task.file is not None:
        output.note(trials.summary())
    check_trials(evidence.trials)
    checked_accuracies(options["accuracies"], evidence.hypotheses)
    say_of_edits(setup.edits)
    model = setup.model(
        evidence.hypotheses, workers=workers, sample_ms=sample_ms(evidence.step_ms)
    ).adapted_to(evidence)
    if (unit := model.circuit.unit) != NATS:
        say(
            f"{model.circuit.name} works in {unit}, not nats: its thresholds are in {unit}, "
            "matched to accuracies expected from the posterior, and compared with the full MSPRT"
        )
    # Other evidence has an arbitrary zero.
    baselines = baselines_on(zero_is_nothing=isinstance(task, Gaussian))
    if left := [name for name in BASELINES if name not in baselines]:
        say(f"{' and '.join(left)} are left out: the zero of this evidence is arbitrary")
    original = setup.intact(evidence.hypotheses)
    intact = None if model.circuit == original else original
    runs = 1 + (intact is not None) + (options["noise_ceiling"] and model.engine.noisy)
    say_before("comparing", model, evidence, runs=runs)
    settings: dict[str, Any] = {"seed": setup.seed, "baselines": baselines, "intact": intact}
    with bar(runs * evidence.trials), collected() as cautions:
        comparison = comparing.compare(model, evidence, **settings, **options)
    if output.json:
        for text in cautions:
            say(text)
    about = (
        f"{model.circuit.name} on {model.engine}, gain {model.gain:g}, seed {setup.seed}, "
        f"{evidence.trials} trials; [95 % intervals: bootstrap over trials]"
    )
    text = f"{about}\n{verdicts(comparison.table, cautions)}\n\n{page(comparison.table)}"
    output.show(text, comparison.table, trials=evidence.trials)
    behind = made_with(model, setup=replace(setup, gain=model.gain), task=task, **options)
    output.write(comparison.table, setup.seed, **behind)
    output.draw(comparison.plot)


TOUCHED = SameDifferent(trials=4000, t_max=40)
"""Default task; its trials are those from which a circuit learns, and as many to score it."""
ENGINE = EngineName("rate")


@like(from_reward.learn, "xi", "runs", "seed", "start", "posterior")
def learn(
    *,
    what: Literal["threshold", "dopamine", "weights"] | None = None,
    task: Annotated[Task, task(TOUCHED)] = TOUCHED,
    circuit: CircuitName | None = None,
    edits: Edited = Edits(),  # noqa: B008
    engine: EngineName = ENGINE,
    gain: float | None = None,
    levels: int | None = None,
    rule: str | None = None,
    learner: Annotated[tuple[str, ...], MANY] = (),
    output: Annotated[Output, FLAT] = Output(),  # noqa: B008
    **options: Any,
) -> None:
    """Let reward move the threshold of the test or of a circuit, a level of dopamine, or weights.

    The threshold of the test is its boundary separation, and that of a circuit the posterior at
    which it decides. A circuit decides every trial at every value first; each run then samples
    values and draws the reward from those decisions. Its level of dopamine is tonic, and the reward
    prediction error phasic. Weights turn readings into evidence. Regret is the cost in excess of
    the best value, on trials that were not used for learning.

    Examples: bgmodel learn --what dopamine --start 1.6 --runs 5 --plot dopamine.png;
    bgmodel learn --what weights --runs 4 --rule chosen --learner trials=2000

    Parameters
    ----------
    what
        What reward moves; by default the threshold of the test, or the dopamine of a circuit.
    circuit
        The circuit that learns, by name or as a .toml file; without it the test does, but for
        dopamine, which is macaque's.
    engine
        Engine of the circuit.
    gain
        Nats in the circuit per nat of evidence; by default the largest at which it tracks it.
    levels
        Number of levels of dopamine, or of log odds, at which the circuit decides.
    rule
        Rule that changes weights: confidence (the default), chosen, reinforce, hebbian or opal.
    learner
        Settings of the learner, name=value: of a threshold or dopamine episodes, rate,
        half_episodes, baseline_rate, last; of weights trials, rate, half_trials, averaged, keep.
    """
    by_circuit = circuit is not None or what == DOPAMINE
    what = what or ("dopamine" if by_circuit else "threshold")
    output.check(task=task, circuit=circuit)
    if not by_circuit:
        idle: dict[str, Any] = {"edits": Edits(), "engine": ENGINE, "gain": None}
        check_idle("the test (no --circuit)", idle, edits=edits, engine=engine, gain=gain)
    usual: Any = WeightLearner() if what == WEIGHTS else Learner()
    more: dict[str, Any] = {"learner": record_of(usual, learner)}
    if what == WEIGHTS:
        check_idle("--what weights", {"xi": from_reward.XI}, xi=options["xi"])
        more |= {"rule": "confidence"}
    given = {"rule": rule, "levels": LEVELS if what == DOPAMINE and levels is None else levels}
    more |= {name: value for name, value in given.items() if value is not None}
    model = None
    if by_circuit:
        say_of_edits(edits)
        setup = Setup(circuit or MACAQUE, edits, engine, gain, options["seed"])
        model = setup.model(task.channels)
        model = replace(model, engine=model.engine.coarse())  # in coarse steps
    settings = {"what": what, **options, **more}
    if what == WEIGHTS:
        settings = {k: v for k, v in settings.items() if k not in ("xi", "start")}
    learns = planned(task, model, what=what, trials=task.trials, **options, **more)
    who = "the test" if model is None else f"{model.circuit.name} on {model.engine}"
    say(f"{who} learns {what}, {task.text}, in {options['runs']} runs")
    with quiet(LearningWarning):
        learned = learns()
    used = learned.details.model if isinstance(learned.details, CircuitLearned) else model
    at = f", gain {used.gain:g}" if used is not None else ""
    text = "\n".join([f"{learned.verdict()}{at}", *learned.cautions])
    summary = {
        "learned": learned.learned.tolist(), "best": learned.best,
        "regret_percent": learned.regrets.to_dict("index"), "cautions": list(learned.cautions),
    }  # fmt: skip
    output.show(text, learned.table, **summary)
    output.write(learned.table, options["seed"], summary=summary, **_behind(used, task, settings))
    output.draw(learned.plot)


def _behind(model: BasalGanglia | None, task: Task, settings: dict[str, Any]) -> dict[str, Any]:
    """Return the options in effect and the circuit, for the provenance of the result."""
    command = {"task": recorded(task), **options_of(**settings)}
    if model is None:
        return {"command": command}
    about = {"engine": model.engine.id, "gain": model.gain}
    return {"command": command | about, "circuit": identity(model.circuit)}
