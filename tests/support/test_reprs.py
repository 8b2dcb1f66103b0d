"""What repr and a notebook show of records, and the Axes that their plots return."""

from dataclasses import replace

import matplotlib.pyplot as plt
import numpy as np
import pytest
from matplotlib.figure import Figure

from bgmodel import BasalGanglia, Evidence, Msprt, first_crossing
from bgmodel.deciding.decision import Decision
from bgmodel.deciding.measures import OF_ALL
from bgmodel.deciding.tally import tally
from bgmodel.deciding.tradeoff import tradeoff
from bgmodel.experiments.experiment import Experiment
from bgmodel.plots import LABELS
from bgmodel.support.reprs import Facts, span
from circuits.anatomy import load_circuit
from circuits.engines import Ensemble
from tests.helpers import refused, some_evidence

EVIDENCE = some_evidence(trials=120, prior=[0.5, 0.3, 0.2], onset_ms=100.0, step_ms=50.0)
TRACE = Msprt().run(EVIDENCE)
THRESHOLDS = np.linspace(0.1, 0.6, 5)


@pytest.fixture(scope="module")
def outcome():
    experiment = replace(Experiment.from_toml("accuracy_threshold"), engine="algebra")
    return replace(experiment, task=replace(experiment.task, trials=120)).run()


@pytest.fixture
def records(outcome):
    return [
        EVIDENCE,
        TRACE,
        first_crossing(TRACE, 0.1),
        first_crossing(TRACE, THRESHOLDS, forced=False),
        first_crossing(TRACE, 1e-9, forced=False, checked=False),
        tally(TRACE, EVIDENCE.truth, THRESHOLDS),
        tradeoff(TRACE, EVIDENCE),
        BasalGanglia(load_circuit("spiking_msprt"), Ensemble(workers=2), 0.7, 3),
        outcome,
    ]


def test_a_record_is_one_short_line_and_a_table_of_the_same_facts(records):
    for record in records:
        line, page = repr(record), record._repr_html_()
        assert len(line) < 260
        assert "\n" not in line
        assert "array(" not in line
        assert page.count("<tr>") == len(record.facts())
        for name, value in record.facts().items():
            assert f"{name} {value}" in line


def test_of_many_thresholds_trials_are_counted_at_each():
    decision = first_crossing(TRACE, THRESHOLDS, forced=False)
    facts = decision.facts()
    assert facts["thresholds"] == str(len(THRESHOLDS))
    assert facts["trials"] == str(EVIDENCE.trials)
    counts = {
        "undecided": (decision.choice == -1).sum(axis=1),
        "premature": decision.premature.sum(axis=1),
        "forced": first_crossing(TRACE, THRESHOLDS).forced.sum(axis=1),
    }
    facts["forced"] = first_crossing(TRACE, THRESHOLDS).facts()["forced"]
    assert counts["forced"].any()
    for name, count in counts.items():
        assert facts[name] == span(count, ".0f")


def test_what_is_not_known_is_said_and_nothing_is_warned_of(recwarn):
    blank = first_crossing(TRACE, 1e-9, forced=False, checked=False)
    assert "mean_time_ms unknown" in repr(blank)
    assert f"undecided {EVIDENCE.trials}" in repr(blank)
    assert "truth unknown" in repr(Evidence(np.zeros((2, 3, 2))))
    assert not recwarn.list


def test_evidence_says_by_how_much_the_truth_is_favoured():
    values = np.zeros((2, 4, 3))
    values[:, :2, 1] = 0.6
    drawn = Evidence(values, np.array([1, 1]), lengths=np.array([2, 2]))
    assert "truth known, favoured by 0.6 nats per reading" in repr(drawn)
    assert "readings up to 4" in repr(drawn)


def test_a_table_of_facts_is_escaped():
    class Odd(Facts):
        def facts(self):
            return {"<b>": "a & b"}

    assert "<th>&lt;b&gt;</th><td>a &amp; b</td>" in Odd()._repr_html_()
    assert span([np.nan, 2, 1]) == "1 to 2"
    assert span([3.0, 3.0]) == "3"


def test_a_trace_is_drawn_up_to_the_end_of_its_trial():
    ax = Figure().subplots()
    short = replace(TRACE, ends=np.full(EVIDENCE.trials, 7))
    assert short.plot(3, ax) is ax.figure
    assert len(ax.lines) == 4
    assert (ax.lines[1].get_ydata() == TRACE.out_nats[3, :7, 1]).all()
    assert ax.lines[1].get_xdata()[0] == TRACE.time_ms[0] - 100
    with refused("trial"):
        TRACE.plot(120)


def test_times_are_drawn_by_choice_and_every_decided_trial_counts():
    decision = replace(first_crossing(TRACE, 0.05, forced=False), truth=None)
    left = int((decision.choice < 0).sum())
    assert 0 < left < EVIDENCE.trials
    (ax,) = decision.plot().axes
    height = sum(bar.get_height() for bars in ax.containers for bar in bars)
    assert height == EVIDENCE.trials - left
    assert ax.get_title("left") == f"n = {EVIDENCE.trials}, {left} undecided"
    blank = first_crossing(TRACE, 1e-9, forced=False, checked=False).plot()
    assert blank.axes[0].get_title("left") == "n = 120, 120 undecided"


def test_several_thresholds_are_drawn_as_speed_and_accuracy():
    decision = first_crossing(TRACE, THRESHOLDS)
    (ax,) = decision.plot(Figure().subplots(), EVIDENCE.truth).axes
    counts = tally(TRACE, EVIDENCE.truth, THRESHOLDS)
    order = np.argsort(counts.mean_steps)
    assert ax.lines[0].get_ydata() == pytest.approx(np.asarray(counts.accuracy)[order])
    times = np.nanmean(decision.time_ms, axis=1)
    assert ax.lines[0].get_xdata() == pytest.approx(np.sort(times))
    with refused("truth several thresholds need the truth"):
        replace(decision, truth=None).plot()


def test_speed_and_accuracy_are_those_of_decided_trials():
    """Three thresholds: two of three trials decided, none of them, one alone."""
    nan = np.nan
    decision = Decision(
        choice=np.array([[0, 1, -1], [-1, -1, -1], [0, -1, -1]]),
        time_ms=np.array([[20.0, 40.0, nan], [nan, nan, nan], [10.0, nan, nan]]),
        forced=np.zeros((3, 3), bool),
        premature=np.zeros((3, 3), bool),
        step_ms=10.0,
        deadline_ms=np.full(3, 50.0),
    )
    line = decision.plot(Figure().subplots(), np.zeros(3, int)).axes[0].lines[0]
    assert line.get_xdata().tolist() == [10, 30]
    assert line.get_ydata().tolist() == [1, 0.5]
    facts = decision.facts()
    assert (facts["thresholds"], facts["trials"]) == ("3", "3")
    assert (facts["mean_time_ms"], facts["undecided"]) == ("10 to 30", "1 to 3")


def test_an_outcome_is_a_forest_of_changes_with_their_verdicts(outcome):
    figure = outcome.plot()
    measures = outcome.measures
    change = measures[(measures["condition"] == "change") & measures["value"].notna()]
    shown = set(change["measure"]) - {"decided"}
    if not measures.loc[measures["measure"] == "missed", "value"].any():
        shown -= set(OF_ALL)
    rows = [text.get_text() for ax in figure.axes for text in ax.get_yticklabels()]
    assert sorted(rows) == sorted(LABELS[name] for name in shown)
    texts = [text.get_text().lower() for ax in figure.axes for text in ax.texts]
    assert all(verdict in texts for verdict in outcome.verdicts()["outcome"])
    plt.close(figure)


def test_a_plot_makes_a_figure_of_its_own_where_no_axes_are_given():
    figure = TRACE.plot()
    assert figure in map(plt.figure, plt.get_fignums())
    plt.close(figure)
