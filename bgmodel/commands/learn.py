"""The command for learning a threshold, a level of dopamine, or weights of readings from reward."""

from __future__ import annotations

from dataclasses import replace
from typing import Annotated, Any, Literal

from bgmodel.commands.options import FLAT, MANY, Edited, like, record_of, task
from bgmodel.commands.output import Output, check_idle, options_of, say, say_of_edits
from bgmodel.conditions import Setup
from bgmodel.integrators.basal_ganglia import BasalGanglia
from bgmodel.learning import from_reward
from bgmodel.learning.dopamine_learner import LEVELS, CircuitLearned
from bgmodel.learning.from_reward import DOPAMINE, WEIGHTS, planned
from bgmodel.learning.reinforce import Learner, LearningStopped, course
from bgmodel.learning.weights.deciders import Feedback, WeightLearner
from bgmodel.names import MACAQUE, CircuitName, EngineName
from bgmodel.support.files import recorded
from bgmodel.tactile.task import SameDifferent
from bgmodel.task import Task
from circuits.declaration.edits import Edits
from circuits.declaration.table_writer import identity
from circuits.errors import LearningWarning, quiet

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
    feedback: Annotated[tuple[str, ...], MANY] = (),
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
        Rule that changes weights: confidence (the default), chosen, reinforce, covariance, hebbian,
        q or opal.
    learner
        Settings of the learner, name=value: of a threshold or dopamine episodes, rate,
        half_episodes, baseline_rate, carried, last; of weights trials, rate, half_trials,
        gain_plus, gain_minus, trace_decay, averaged, keep.
    feedback
        How reliable feedback is while weights are learned, name=value: right, wrong, valid, given.
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
        more |= {"feedback": Feedback(), "rule": "confidence"}
    given = {"feedback": record_of(Feedback(), feedback) if feedback else None, "rule": rule,
             "levels": LEVELS if what == DOPAMINE and levels is None else levels}  # fmt: skip
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
    try:
        with quiet(LearningWarning):
            learned = learns()
    except LearningStopped as stop:
        if output.save is None:
            raise
        table = course(stop.learned, mean="mean", played="played", error="dopamine")
        output.write(table, options["seed"], **_behind(model, task, settings))
        raise ValueError(f"{stop}; learning up to then -> {output.save}") from None
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
