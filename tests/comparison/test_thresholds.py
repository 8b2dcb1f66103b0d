"""Thresholds of comparisons are placed by accuracy, and the gain of a circuit by its speed."""

import re
import warnings

import numpy as np
import pytest

from bgmodel import BasalGanglia, compare, gaussian_evidence
from bgmodel.comparison.page import NOT_REACHED, verdicts
from bgmodel.comparison.thresholds import GAINS, fastest_gain
from circuits.anatomy import load_circuit
from circuits.errors import DeadlineWarning, InputError, RangeWarning
from tests.comparison.deadlines import Task, changed, compared


@pytest.mark.parametrize("seed", [1, 8, 12])
def test_a_later_deadline_changes_nothing(seed):
    """Strong evidence, populations and rates, cues on a lattice; 100 tasks in `make validate`."""
    both = compared(Task.drawn(seed))
    assert both["value_long"].notna().any()
    assert changed(both).empty


def said_of(model, evidence, accuracies):
    """Return a comparison and its warnings, as (category, text)."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        comparison = compare(model, evidence, accuracies=accuracies, resamples=100)
    return comparison, [(one.category, str(one.message)) for one in caught]


RATES = BasalGanglia(load_circuit("macaque"), "rate", seed=1)
REASONS = {
    "one reading": ((3.0, 20), (0.9, 0.97), RangeWarning, "one reading alone gives 0.92"),
    "readings": ((0.5, 10), (0.9, 0.65), DeadlineWarning, "all readings of a trial, 10 at most"),
    "deadline": ((0.5, 10), (0.79, 0.65), DeadlineWarning, "the deadline decides .* readings"),
    "read-out": ((0.5, 200), (0.998, 0.9), RangeWarning, "its read-out resolves no OUT below"),
}
"""d' and readings; an accuracy that can't be compared, and one that can; the warning."""


@pytest.mark.parametrize("reason", REASONS)
def test_what_cannot_be_compared_has_its_reason_also_where_others_can(reason):
    (d_prime, readings), accuracies, category, text = REASONS[reason]
    evidence = gaussian_evidence(200, d_prime=d_prime, t_max=readings, seed=1)
    comparison, warned = said_of(RATES, evidence, accuracies)
    rows = comparison.table.query("model == 'circuit' and measure == 'agreement'")
    known = rows.groupby("accuracy")["value"].agg(lambda values: values.notna().all())
    assert known.to_dict() == dict(zip(accuracies, (False, True), strict=True))
    # Once, at the accuracy that it is about.
    (named,) = [one for one in warned if re.search(rf"accuracy (of )?{accuracies[0]}:", one[1])]
    assert issubclass(named[0], category)
    assert re.search(text, named[1])
    lines = verdicts(comparison.table, [named[1]]).splitlines()
    at = lines.index(f"  at {accuracies[0]:g}: {NOT_REACHED}")
    assert "warning" in lines[at + 1]


def test_without_reason_nothing_is_said():
    evidence = gaussian_evidence(200, d_prime=0.7, t_max=120, seed=1)
    comparison, warned = said_of(RATES, evidence, (0.8, 0.9, 0.95, 0.97))
    assert not warned
    assert NOT_REACHED not in verdicts(comparison.table)


EVIDENCE = gaussian_evidence(200, d_prime=0.5, t_max=100, seed=1)


def test_a_circuit_in_nats_keeps_its_gain_and_another_gets_the_fastest():
    model, _ = fastest_gain(load_circuit("spiking_msprt"), "rate", EVIDENCE, 1)
    assert model.gain == model.circuit.default_gain
    assert fastest_gain(load_circuit("bogacz_gurney"), "rate", EVIDENCE, 1)[0].gain == 1
    model, decided = fastest_gain(load_circuit("gpr"), "rate", EVIDENCE, 1)
    assert model.gain in GAINS
    slow, slower = fastest_gain(load_circuit("gpr"), "rate", EVIDENCE, 1, gain=0.05)
    assert slow.gain == 0.05
    at = [np.interp(0.9, np.sort(one.posterior.mean(axis=1)), np.sort(one.time_ms.mean(axis=1)))
          for one in (decided, slower)]  # fmt: skip
    assert at[0] <= at[1]


def test_a_circuit_that_rests_below_its_thresholds_is_refused():
    with pytest.raises(InputError):
        fastest_gain(load_circuit("linear_gpe"), "rate", EVIDENCE, 1)
