"""Report on one sensor: information per tap, and decisions of test, learner and circuit."""

from __future__ import annotations

import base64
import html
import io
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import numpy as np
import pandas as pd
from scipy.special import softmax
from scipy.stats import circstd

from bgmodel.bootstrap import check_trials, shown
from bgmodel.comparison.compare import compare
from bgmodel.comparison.thresholds import MSPRT_AT_GAIN
from bgmodel.deciding.decision import first_crossing
from bgmodel.evidence import Evidence
from bgmodel.integrators.at_thresholds import CIRCUIT, DECODER
from bgmodel.integrators.basal_ganglia import BasalGanglia
from bgmodel.integrators.sprt import Msprt, threshold_from_posterior
from bgmodel.learning.dopamine_learner import (
    CRITERION,
    POPULATIONS,
    SPIKES,
    TEST,
    CircuitLearned,
    decide_as_learned,
    learn_in_circuit,
)
from bgmodel.learning.gap import learn_gap
from bgmodel.learning.reinforce import Learned, Learner
from bgmodel.support.checks import whole
from bgmodel.support.saved import Facts
from bgmodel.support.seeds import stream
from bgmodel.support.tables import Readable
from bgmodel.tactile.pressing import PERIODS_MM
from bgmodel.tactile.source import Folds, Source, Tactile, check_folds, load_taps
from bgmodel.tactile.source import folds as folds_of
from bgmodel.tactile.task import SameDifferent
from circuits.anatomy import DEFAULT, load_circuit
from circuits.arrays import Array
from circuits.engines import engine_of
from circuits.errors import InputError, collected, require
from circuits.plots import PALETTE, look, panels, saved, styled

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

POSTERIOR = 0.9
"""Posterior at which the test in the table and the example decision stop."""
ACCURACIES = (0.8, 0.85, 0.9, 0.95)
"""Accuracies at which circuit and test are compared, as far as the taps allow."""
XI, START_SEPARATION, RUNS = 50.0, 0.5, 5
"""Cost of an error (readings), initial gap (nats) and number of runs of the learner."""
T_MAX, FOLDS = 40, 10
"""Readings of the longest trial, and default number of folds of taps."""
TO_LEARN, TO_SPIKE = 6000, 480
"""Trials from which the circuit learns its threshold, by populations, and largest number of trials
that it decides in spikes."""
STEPS_DEG = (1.0, 2.0, 3.0, 5.0, 8.0, 12.0, 20.0)
"""Angular steps of the psychometric curve of an edge, degrees."""
PARTS = ("psychometric", "curves", "table", "learning", "learned", "courses", "decided")
"""Tables of a result."""
LETTERS = ("a  ", "b  ", "c  ", "d  ")


@dataclass(frozen=True, repr=False)
class Touched(Facts):
    """Results for one sensor's decoded taps."""

    axis: str  # quantity that varies between stimuli, with its unit
    # One row per stimulus: accuracy of a reading (mean, low and high over folds of taps);
    # claimed, the mean posterior of the likeliest hypothesis, equal to the accuracy if
    # calibrated; spread_deg, the SD of readings within a hypothesis; shrink, the factor on
    # log-likelihoods that best predicts held-out taps, 0 for uninformative readings.
    psychometric: pd.DataFrame
    curves: pd.DataFrame  # tradeoff of test and circuit: model, accuracy, mean_ms
    table: pd.DataFrame  # circuit and test at equal accuracy, see Comparison.table
    # who, run, episode, mean_separation: the boundary separation of the test, and the one that
    # corresponds to the circuit's threshold, nats of evidence; with more than two alternatives
    # the log odds of its posterior.
    learning: pd.DataFrame
    learned: pd.DataFrame  # from decide_as_learned
    numbers: dict[str, float]  # summary measures by name
    # OUT of "test" and "circuit in spikes" on one trial: who, channel, time_ms, out_nats.
    courses: pd.DataFrame
    decided: pd.DataFrame  # their decisions on this trial: who, choice, time_ms
    step_ms: float
    remarks: tuple[str, ...] = ()  # warnings of the analysis

    def facts(self) -> dict[str, str]:
        """Return the axis and the summary measures."""
        return {"stimuli": self.axis} | {name: f"{x:.4g}" for name, x in self.numbers.items()}

    def summary(self) -> pd.DataFrame:
        """Return the numbers as a table: measure and value."""
        return Readable(self.numbers.items(), columns=["measure", "value"])

    def learned_summary(self) -> pd.DataFrame:
        """Return decisions with the learned settings: a row per measure, a column per decider."""
        if not len(self.learned):
            return pd.DataFrame()
        every = self.learned[["value", "low", "high"]].to_numpy()
        forms = np.where(self.learned["measure"] == "accuracy", ".3f", ".2f")
        texts = [
            shown(x, low, high, form) for (x, low, high), form in zip(every, forms, strict=True)
        ]
        long = self.learned.assign(text=texts)
        wide = long.pivot(index="measure", columns="who", values="text").fillna("")
        ordered = wide.loc[long["measure"].unique(), long["who"].unique()]
        return Readable(ordered.reset_index().rename_axis(columns=None))

    def to_dataframe(self) -> pd.DataFrame:
        """Return all tables as one, with a column ``part`` that names the table of each row."""
        parts = {name: getattr(self, name) for name in PARTS} | {"numbers": self.summary()}
        every = [rows.assign(part=name) for name, rows in parts.items() if len(rows)]
        return cast("pd.DataFrame", pd.concat(every))

    @classmethod
    def from_dataframe(cls, rows: pd.DataFrame, axis: str, step_ms: float) -> Touched:
        """Return the result from its table, its axis and the time between readings."""
        parts = {name: rows[rows["part"] == name].dropna(axis=1, how="all") for name in PARTS}
        numbers = rows[rows["part"] == "numbers"]
        values = dict(zip(numbers["measure"], numbers["value"], strict=True))
        return cls(axis, numbers=values, step_ms=step_ms, **parts)  # type: ignore[arg-type]

    @styled
    def plot(self) -> Figure:
        """Draw one reading, speed and accuracy, the learned criteria, and one decision in spikes.

        Panel a: accuracy of a single reading, mean and range over folds of taps, with the mean
        posterior of the likeliest hypothesis. Panel b: expected accuracy over mean decision time of
        test and populations, with pointwise 95 % intervals; markers are the decisions of test and
        spikes at what each learned. Panel c: the learned gap of the test, and the circuit's,
        learned by populations; median and 10 to 90 % of runs. Panel d: OUT in spikes on one trial;
        vertical lines are decisions.
        """
        figure, axes = panels(2, 2, size=(7.2, 5.4))
        self.draw(axes.flat)
        return figure

    def draw(self, axes: Iterable[Axes], letters: Sequence[str] = LETTERS) -> None:
        """Draw the four panels on given axes; letters begin their titles."""
        for panel, letter, ax in zip(PANELS, letters, axes, strict=True):
            panel(ax, self)
            title = ax.get_title("left") or ax.get_title()
            ax.set_title("", loc="center")
            ax.set_title(f"{letter}{title}", loc="left")
            ax.spines[["top", "right"]].set_visible(False)


def touch(
    task: Tactile | None = None,
    taps: pd.DataFrame | str | Path | None = None,
    model: BasalGanglia | None = None,
    *,
    values: Sequence[float] | None = None,
    trials: int = 1200,
    folds: int = FOLDS,
    step_ms: float = 50.0,
    learner: Learner | None = None,
    seed: int = 0,
    workers: int = 2,
) -> Touched:
    """Decide on decoded taps by the test and by the circuit, and let reward set the criteria.

    The circuit learns by populations and decides in spikes.

    Parameters
    ----------
    task : Tactile, optional
        The question, such as ``EdgeTurn(2, step_deg=5)``; by default ``SameDifferent()``.
    taps : DataFrame or path, optional
        Decoded taps, as from ``load_taps`` or ``Decoder.decode``; by default those of the task.
    model : BasalGanglia, optional
        The circuit and its gain, by default ``BasalGanglia("macaque")``. Its engine and the seed of
        its noise have no effect.
    values : sequence of float, optional
        Stimuli of the psychometric curve, mm or degrees.
    trials : int
        Number of trials on which test and circuit decide.
    folds : int
        Number of folds of taps: likelihoods are fitted on the others, and intervals resample folds.
    step_ms : float
        Time between readings, ms.
    learner : Learner, optional
        Learner of gap and threshold; by default ``Learner()``.
    seed : int
        Seed of evidence and noise.
    workers : int
        Number of threads.

    Raises
    ------
    ValueError
        If the task is not tactile, there are too few taps or trials for it, or the circuit does not
        work in nats or has a different number of channels.
    """
    task = SameDifferent() if task is None else task
    if not isinstance(task, Tactile):
        raise InputError.of("task", "must be a tactile task, such as bg.SameDifferent()", task)
    if model is None:
        model = BasalGanglia(load_circuit(DEFAULT, len(task.names)))
    check(task, model, trials, folds)
    grating, value = task.stimulus == "grating", float(getattr(task, task.main))
    if values is None:
        values = PERIODS_MM if grating else STEPS_DEG
    axis = "period of the grating (mm)" if grating else "step between alternatives (deg)"

    def task_of(stimulus: float) -> Tactile:
        return task.changed(**{task.main: stimulus})

    with collected() as caught:
        taps = load_taps(task.taps if taps is None else taps)
        readings = folds_of(taps, task, folds)
        readings.sources[0].warn_if_silent()
        evidence = readings.draw(trials, T_MAX, rng=stream(seed, "touch"), step_ms=step_ms)
        stimuli = sorted({*values, value})
        curve = pd.DataFrame([_one_reading(taps, task_of(each), each, folds) for each in stimuli])
        engine = engine_of("population", workers=workers)
        model = replace(model, engine=engine, seed=seed).adapted_to(evidence)
        groups = readings.groups(trials)
        matched = compare(model, evidence, accuracies=ACCURACIES, groups=groups, seed=seed)
        taught = chain(readings, model, evidence, learner or Learner(), seed, workers, TO_SPIKE)
        courses, decided = _one_decision(model, evidence, taught.threshold)
    test = Msprt().decide(evidence, posterior=POSTERIOR)
    numbers: dict[str, float] = {
        "hypotheses": len(task.names),
        "one_reading_accuracy": float(curve.set_index("stimulus")["accuracy"][value]),
        "test_accuracy": float(test.accuracy),
        "test_readings": float(test.time_ms.mean() / step_ms),
        **_at_equal_accuracy(matched.table),
        "gain": model.gain,
        "folds": folds,
        "spiking_trials": min(trials, TO_SPIKE),
        **taught.gap,
    }
    return Touched(
        axis, curve, matched.curves, matched.table, taught.courses, taught.learned, numbers,
        courses, decided, step_ms, tuple(dict.fromkeys(caught)),
    )  # fmt: skip


def check(task: Tactile, model: BasalGanglia, trials: int, folds: int) -> None:
    """Raise ValueError for too few trials, or a circuit without nats or with other channels."""
    check_folds(whole("trials", trials, 1), folds)
    check_trials(trials)
    model.circuit.check_nats("a learned posterior")
    channels, must = model.circuit.channels, f"must have {len(task.names)} channels, as the task"
    require(channels == len(task.names), "model", must, channels)


def _one_reading(
    taps: pd.DataFrame, task: Tactile, stimulus: float, folds: int
) -> dict[str, float]:
    """Return measures of one reading at a stimulus; see ``Touched.psychometric``."""
    sources = folds_of(taps, task, folds).sources
    accuracy = [_over_hypotheses(source, _right) for source in sources]
    claimed = [_over_hypotheses(source, _claimed) for source in sources]
    shrink = np.mean([source.likelihood.shrink for source in sources])
    return {
        "stimulus": stimulus, "accuracy": float(np.mean(accuracy)), "low": min(accuracy),
        "high": max(accuracy), "claimed": float(np.mean(claimed)),
        "spread_deg": _spread_deg(taps, task), "shrink": float(shrink),
    }  # fmt: skip


def _over_hypotheses(source: Source, measure: Callable[[Array, int], float]) -> float:
    """Return the mean over hypotheses of a measure of the readings under each."""
    each = [measure(readings, truth) for truth, readings in enumerate(source.log_likelihood)]
    return float(np.mean(each))


def _right(log_likelihood: Array, truth: int) -> float:
    """Return the fraction of readings whose likeliest hypothesis is true; ties are split."""
    best = log_likelihood == log_likelihood.max(axis=1, keepdims=True)
    return float((best[:, truth] / best.sum(axis=1)).mean())


def _claimed(log_likelihood: Array, truth: int) -> float:
    """Return the mean posterior of the likeliest hypothesis."""
    return float(softmax(log_likelihood, axis=1).max(axis=1).mean())


def _spread_deg(taps: pd.DataFrame, task: Tactile) -> float:
    """Return the standard deviation of readings within a hypothesis, averaged over hypotheses."""
    low, high = task.range_deg
    each = task.readings(task.pool(taps))
    sds = [circstd(one, high, low) if task.circular else np.std(one) for one in each]
    return float(np.mean(sds))


def _at_equal_accuracy(table: pd.DataFrame) -> dict[str, float]:
    """Return agreement, RT correlation and extra time at the highest accuracy available."""
    rows = table[(table["model"] == CIRCUIT) & (table["reference"] == MSPRT_AT_GAIN)]
    known = rows[rows["value"].notna() & rows["accuracy"].notna()]
    wide = known.pivot(index="accuracy", columns="measure", values="value")
    names = [n for n in ("agreement", "pearson_r", "extra_ms") if n in wide]
    wide = wide.dropna(subset=names)
    if not len(wide):
        return {}
    last = wide.iloc[-1]
    return {"compared_at_accuracy": float(wide.index[-1])} | {n: float(last[n]) for n in names}


@dataclass(frozen=True)
class LearnedFromTaps:
    """Settings that test and circuit learned from reward, and their decisions with these."""

    courses: pd.DataFrame  # see Touched.learning; empty if readings are uninformative
    learned: pd.DataFrame  # likewise, see Touched.learned
    gap: dict[str, float]  # the test's learned gap, the best one, regret; empty for N > 2
    circuit: CircuitLearned | None = None

    @property
    def threshold(self) -> float | None:
        """The learned threshold on OUT, nats; None if nothing could be learned."""
        return None if self.circuit is None else self.circuit.threshold_nats


def chain(
    readings: Folds,
    model: BasalGanglia,
    evidence: Evidence,
    learner: Learner,
    seed: int,
    workers: int,
    spiking: int,
) -> LearnedFromTaps:
    """Let reward set the gap of the test and the threshold of the circuit, and decide with both.

    The circuit learns by populations, at the gain that it decides with, and decides the first
    ``spiking`` trials of the evidence in spikes.
    """
    pooled = readings.pooled
    if pooled.silent:
        return LearnedFromTaps(pd.DataFrame(), pd.DataFrame(), {})
    settings: dict[str, Any] = {"xi": XI, "runs": RUNS, "seed": seed, "learner": learner}
    gap, courses = {}, []
    if len(pooled.names) == 2:
        of_test = learn_gap(
            pooled, name=(0.0, 0), start_separation=START_SEPARATION, t_max=T_MAX, **settings
        )
        courses.append(_course(of_test.learned, TEST))
        gap = {
            "learned_gap_nats": float(np.mean(of_test.learned.learned)),
            "optimal_gap_nats": float(of_test.optimum.boundary_separation),
            "learned_gap_regret_percent": 100 * float(np.mean(of_test.regret)),
        }
    rng, step_ms = stream(seed, "touch, learned"), evidence.step_ms
    before = readings.draw(TO_LEARN, T_MAX, rng=rng, step_ms=step_ms)
    circuit = learn_in_circuit(model, before, evidence, what=CRITERION, **settings)
    courses.append(_course(circuit.learned, POPULATIONS))
    if gap:
        courses[-1]["mean_separation"] *= 2 / model.gain
    few = evidence[:spiking]
    gaps = (gap["learned_gap_nats"], gap["optimal_gap_nats"]) if gap else None
    learned = decide_as_learned(
        circuit, few, gaps=gaps, groups=readings.groups(few.trials),
        engine=engine_of("spikes", workers=workers), seed=seed,
    )  # fmt: skip
    return LearnedFromTaps(pd.concat(courses), learned, gap, circuit)


def _course(learned: Learned, who: str) -> pd.DataFrame:
    """Return the mean value of each trial and run of a learner."""
    table = learned.to_dataframe().rename(columns={"mean": "mean_separation"})
    return table[["run", "episode", "mean_separation"]].assign(who=who)


def _one_decision(
    model: BasalGanglia, evidence: Evidence, threshold: float | None
) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Return OUT and decision of test and spiking circuit on one trial (first of second fold)."""
    one, gain = evidence[1:2], model.gain
    model = replace(model, engine="spikes")
    if threshold is None:
        threshold = float(threshold_from_posterior(_readable(model), evidence.hypotheses))
    courses, decided = [], []
    deciders: dict[str, Msprt | BasalGanglia] = {TEST: Msprt(gain), SPIKES: model}
    for who, decider in deciders.items():
        cells = isinstance(decider, BasalGanglia)
        trace = model.trace(model.activity(one, checked=False), one) if cells else decider.run(one)
        out = pd.DataFrame(np.asarray(trace.out_nats[0]), index=pd.Index(trace.time_ms))
        out = out.rename_axis("time_ms").reset_index()
        long = out.melt("time_ms", var_name="channel", value_name="out_nats").assign(who=who)
        courses.append(long.astype({"channel": int}))
        decision = first_crossing(trace, threshold, forced=False, checked=False)
        decided.append((who, int(decision.choice[0]), float(decision.time_ms[0])))
    columns = ["who", "choice", "time_ms"]
    return pd.concat(courses), pd.DataFrame(decided, columns=columns)


def _readable(model: BasalGanglia) -> float:
    """Return the posterior of the example decision, clipped to the range the circuit can read."""
    low, high = (float(np.exp(-nats)) for nats in model.circuit.readable_nats[::-1])
    return min(max(POSTERIOR, low), high)


# ---- figure and page


def _psychometric(ax: Axes, of: Touched) -> None:
    from bgmodel.plots import accuracy_axis

    rows = of.psychometric
    ends = [rows["accuracy"] - rows["low"], rows["high"] - rows["accuracy"]]
    ax.errorbar(rows["stimulus"], rows["accuracy"], yerr=ends, capsize=2, marker="o", ms=4,
                color=PALETTE[0], label="Observed (mean, range over folds)")  # fmt: skip
    ax.plot(rows["stimulus"], rows["claimed"], "k:", lw=1, label="Stated by the posterior")
    chance = 1 / of.numbers["hypotheses"]
    accuracy_axis(ax, chance)
    ax.set_ylim(chance - 0.35 * (1 - chance), 1.03)  # the legend is below chance
    ax.set(xlabel=of.axis[:1].upper() + of.axis[1:], ylabel="Proportion correct",
           title="Single reading")  # fmt: skip
    ax.legend(frameon=False, fontsize=7, loc="lower right")


def _speed(ax: Axes, of: Touched) -> None:
    from bgmodel.plots import accuracy_axis

    names = {"MSPRT": "Test (MSPRT)", CIRCUIT: "Circuit (populations)",
             DECODER: "Decoder of its cortical rates"}  # fmt: skip
    for colour, (name, label) in zip(("k", PALETTE[1], PALETTE[0]), names.items(), strict=True):
        rows = of.curves[of.curves["model"] == name].sort_values("mean_ms")
        ax.plot(rows["mean_ms"] / of.step_ms, rows["accuracy"], label=label, color=colour)
        if "low" in rows:  # tables of earlier versions have no interval
            band = (rows["low"], rows["high"])
            ax.fill_between(rows["mean_ms"] / of.step_ms, *band, color=colour, alpha=0.15, lw=0)
    _as_learned(ax, of)
    accuracy_axis(ax, 1 / of.numbers["hypotheses"])
    longest = of.curves.loc[of.curves["model"] == CIRCUIT, "mean_ms"].max() / of.step_ms
    ax.set(xlim=(0, 1.3 * longest), xlabel="Mean decision time (readings)",
           ylabel="Accuracy",
           title="Speed and accuracy")  # fmt: skip
    ax.legend(frameon=False, fontsize=7)


def _as_learned(ax: Axes, of: Touched) -> None:
    """Mark the decisions of test and spikes with learned settings, with 95 % intervals."""
    if not len(of.learned):
        return
    wide = of.learned.pivot(index="who", columns="measure", values=["value", "low", "high"])
    looks = {TEST: ("k", "o", "Test, as learned"),
             SPIKES: (PALETTE[1], "s", "Circuit in spikes, as learned")}  # fmt: skip
    for who, (colour, marker, label) in looks.items():
        if who in wide.index:
            x, y = (wide.loc[who].xs(name, level="measure") for name in ("readings", "accuracy"))
            ends = [[[one["value"] - one["low"]], [one["high"] - one["value"]]] for one in (x, y)]
            ax.errorbar(x["value"], y["value"], xerr=ends[0], yerr=ends[1], fmt=marker, ms=4,
                        color=colour, capsize=2, lw=0.8, label=label)  # fmt: skip


def _learning(ax: Axes, of: Touched) -> None:
    if not len(of.learning):
        ax.set(xticks=[], yticks=[], title="Learning")
        why = "Taps that do not distinguish the\nhypotheses cannot teach a threshold"
        ax.text(0.5, 0.5, why, ha="center", va="center", color="0.4", transform=ax.transAxes)
        return
    from bgmodel.plots import acquisition

    every = of.learning[of.learning["episode"] % 50 == 0]
    names = {TEST: "Test", POPULATIONS: "Circuit (populations)"}
    for colour, (who, label) in zip((PALETTE[0], PALETTE[1]), names.items(), strict=True):
        rows = every[every["who"] == who]
        if len(rows):
            wide = rows.pivot(index="run", columns="episode", values="mean_separation")
            acquisition(ax, wide, color=colour, label=label)
    if "optimal_gap_nats" in of.numbers:
        best = of.numbers["optimal_gap_nats"]
        ax.axhline(best, color="k", lw=0.8, ls="--", label="Best of the test")
    gap = TEST in set(of.learning["who"])
    ax.set(xlabel="Trial",
           ylabel="Boundary separation δ (nats)" if gap else "Log odds of the criterion",
           title="Criterion learned from reward")  # fmt: skip
    ax.legend(frameon=False, fontsize=7)


def _decision(ax: Axes, of: Touched) -> None:
    for who, choice, time_ms in of.decided[["who", "choice", "time_ms"]].itertuples(index=False):
        dashed, steps = ("--", "steps-post") if who == "test" else ("-", "default")
        rows = of.courses[of.courses["who"] == who]
        for channel, course in rows.groupby("channel"):
            colour = look(int(channel))["color"]
            ax.plot(course["time_ms"] / of.step_ms, course["out_nats"], color=colour,
                    ls=dashed, lw=1.1, drawstyle=steps)  # fmt: skip
        ax.plot([], [], color="0.3", label=who[0].upper() + who[1:], ls=dashed)
        if choice >= 0:
            ax.axvline(time_ms / of.step_ms, color="0.3", lw=0.8, ls=dashed)
    if len(of.learned):
        level = of.learned.set_index(["who", "measure"])["value"][SPIKES, "criterion"]
        ax.axhline(level, color="0.3", lw=0.8, ls=":", label="Learned threshold")
    last = max(3.0, of.decided["time_ms"].max() / of.step_ms)
    ax.set(xlim=(0, 1.5 * last), ylim=(0, 3), xlabel="Time (readings)",
           ylabel="OUT (nats)", title="Example decision")  # fmt: skip
    ax.legend(fontsize=7, frameon=True, framealpha=0.9, edgecolor="none")


PANELS = (_psychometric, _speed, _learning, _decision)


def page(of: Touched, title: str, made: str) -> str:
    """Return a story as one HTML page: figure, numbers and warnings; ``made`` is provenance."""
    picture = io.BytesIO()
    saved(of.plot(), picture, format="png")
    encoded = base64.b64encode(picture.getvalue()).decode()
    remarks = "".join(f"<li>{html.escape(text)}</li>" for text in of.remarks)
    numbers, curve, learned = (
        rows.to_html(index=False, float_format=lambda x: f"{x:.4g}", border=0) if len(rows) else ""
        for rows in (of.summary(), of.psychometric, of.learned_summary())
    )
    folds, spikes = (f"{of.numbers.get(name, 0):.0f}" for name in ("folds", "spiking_trials"))
    return f"""<!doctype html>
<html lang="en"><head><meta charset="utf-8"><title>{html.escape(title)}</title>
<meta name="viewport" content="width=device-width">
<style>body {{ font: 1rem/1.5 sans-serif; max-width: 56rem; margin: 2rem auto; padding: 0 1rem }}
img {{ width: 100% }} td, th {{ padding: .1rem 1rem .1rem 0; text-align: left }}
</style></head><body>
<h1>{html.escape(title)}</h1>
<p><img alt="One reading, speed and accuracy, the learned criteria, and one decision"
src="data:image/png;base64,{encoded}"></p>
<p><b>a</b>, accuracy of a single reading (mean and range over {folds} folds of taps) and mean
posterior of the likeliest hypothesis (dotted). <b>b</b>, accuracy against mean decision time, of
the test and of the circuit's population rates with noise (lines: expected accuracy, the mean
posterior of the choice), and of the test and the circuit in spikes at what each learned from reward
(markers: proportion correct); 95 % intervals over folds. <b>c</b>, what is
learned from reward when an error costs {XI:g} readings: the gap of the test, and the circuit's
threshold, learned by populations and drawn as the gap that it corresponds to; median and 10 to
90 % of {RUNS} runs. <b>d</b>, OUT of each alternative on one trial, of the test (at the circuit's
gain) and of the circuit in spikes, one colour for each; both stop at the circuit's learned
threshold (vertical lines).</p>
<p>test_accuracy and test_readings are those of the test that stops at a posterior of {POSTERIOR:g}.
</p>
{numbers}
<h2>At what reward taught</h2>
<p>The same {spikes} trials, decided by the test at its learned gap, and by the circuit at its
learned threshold, as population rates with noise and in spikes. cost is the mean decision time
plus {XI:g} readings per error. criterion is the OUT at which each stops,
nats (of the test at gain 1, of the circuit at its gain). regret is the excess cost over the best
criterion, which was found on other trials (so that it may be below 0 by chance), and
above_test the excess cost over the test, both in per cent; 95 % intervals (bootstrap over folds of
taps).</p>
{learned or "<p>No learning: the taps do not distinguish the hypotheses.</p>"}
<h2>One reading</h2>
<p>For each {html.escape(of.axis)}: how often the likeliest hypothesis is true, with the range
over the folds of taps. claimed is the mean posterior of that hypothesis, equal to the accuracy if
likelihoods are calibrated. spread_deg is the standard deviation of readings within a hypothesis.
shrink is the factor on log-likelihoods that best predicts held-out taps; 0 means that a reading
is uninformative.</p>
{curve}
<h2>Warnings</h2><ul>{remarks or "<li>none</li>"}</ul>
<p>{html.escape(made)}</p></body></html>
"""
