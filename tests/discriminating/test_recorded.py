"""Further trials that tell readings of recorded cells apart, against closed forms."""

from dataclasses import replace

import numpy as np
import pytest

import bgmodel as bg
from bgmodel.discriminating.recorded import FEWEST_TRIALS, apart, simulated
from bgmodel.discriminating.result import INSEPARABLE, SEPARABLE
from bgmodel.discriminating.space import Space
from bgmodel.fitting.cells.sessions import BIN_S
from bgmodel.fitting.optimum import optimum
from circuits.errors import quiet
from tests.fitting.cells.test_model import clicked, likelihood_of, true_vector
from tests.helpers import refused

FEW = {"pilots": 4, "check_trials": 400}


def truth(cells=4, gain=0.4, trials=100):
    """Return an exponential reading, with cells of one gain of either sign."""
    likelihood = likelihood_of(clicked(trials, cells))
    vector = true_vector(likelihood, noise=2.0)
    for k in range(cells):
        vector[likelihood.freedom.names.index(f"{k} gain")] = gain * (-1) ** k
    return likelihood, vector


def drawn(likelihood, vector, seed=1):
    return likelihood.simulated(vector, np.random.default_rng(seed))


@pytest.fixture(scope="module")
def pilot():
    """Return trials of two sessions, with two cells in each."""
    trials = drawn(*truth(gain=0.8))
    spikes, recorded = trials.spikes, np.zeros((100, 4), bool)
    recorded[:50, :2] = recorded[50:, 2:] = True
    kept = recorded[spikes.trial, spikes.cell]
    parts = {name: getattr(spikes, name)[kept] for name in ("trial", "cell", "time_s")}
    names = ("a.1", "a.2", "b.1", "b.2")
    return replace(trials, spikes=replace(spikes, names=names, recorded=recorded, **parts))


@pytest.fixture(scope="module")
def found(pilot):
    return bg.discriminate("exponential", "step", recorded=pilot, **FEW)


def test_a_cell_without_gain_tells_as_much_as_poisson_counts_of_its_rates():
    """KL of Poisson counts: a ln(a / b) - a + b."""
    likelihood, first = truth(cells=2, gain=0.0)
    second, rates = first.copy(), np.exp([2.0, 2.3])
    for k, name in enumerate(likelihood.freedom.names):
        if "past" in name:
            first[k] = second[k] = 0.0
        elif "course" in name:
            second[k] = np.log(rates[1])
    counted_s = np.mean([each.bins * BIN_S for each in likelihood.sessions])
    exact = 2 * counted_s * (rates[0] * np.log(rates[0] / rates[1]) - rates[0] + rates[1])
    nats = np.array([
        apart((likelihood, first), (likelihood, second),
              simulated((likelihood, first), np.random.default_rng(seed))).mean()
        for seed in range(40)
    ])  # fmt: skip
    assert nats.mean() == pytest.approx(exact, abs=4 * nats.std() / np.sqrt(len(nats)))
    assert 4 * nats.std() / np.sqrt(len(nats)) < 0.2 * exact


def test_the_difference_from_the_best_fit_of_the_other_is_a_divergence_and_more_cells_tell_more():
    told = {}
    for cells in (2, 6):
        likelihood, vector = truth(cells, gain=0.3)
        other = likelihood_of(clicked(100, cells), "step")
        many = simulated((likelihood, vector), np.random.default_rng(2))
        rival = optimum(replace(other, sessions=many)).vector
        true, false = (likelihood, vector), (other, rival)
        for way, (mine, theirs) in {"first": (true, false), "second": (false, true)}.items():
            nats = np.concatenate([
                apart(mine, theirs, simulated(mine, np.random.default_rng(seed)))
                for seed in range(3, 15)
            ])  # fmt: skip
            error = nats.std() / np.sqrt(len(nats))
            assert nats.mean() > 4 * error
            told[way, cells] = nats.mean(), error
    for way in ("first", "second"):
        (few, error), (more, more_error) = told[way, 2], told[way, 6]
        assert more - few > 3 * np.hypot(error, more_error)


def test_cells_with_gains_tell_encodings_apart(found):
    assert found.verdict == SEPARABLE
    needed = found.sequential
    assert (abs(needed["simulated_median"] - needed["median"]) <= 0.2 * needed["median"] + 1).all()
    assert ((needed["low"] < needed["median"]) & (needed["median"] < needed["high"])).all()


def test_a_pilot_whose_fits_mislead_is_said_to_be_too_small(found):
    rows = found.sequential.assign(median=np.inf, right=[0.7, 0.9])
    misled = replace(found, sequential=rows).sentence()
    assert misled.startswith("cannot tell: after a pilot of this size 30 % of")


def test_cells_without_gain_do_not():
    with quiet():
        none = bg.discriminate("exponential", "linear", recorded=drawn(*truth(gain=0.0)), **FEW)
    assert none.verdict == INSEPARABLE
    assert none.sequential["median"].tolist() == [np.inf, np.inf]
    assert (none.sequential["nats"].abs() < 4 * none.sequential["error"]).all()
    assert none.most_nats < 0.1
    # Fits to a pilot can then only mislead: the sentence says how often.
    assert none.sentence().startswith("cannot tell: after a pilot of this size")


def test_results_depend_neither_on_workers_nor_on_the_order_of_encodings(pilot, found):
    swapped = bg.discriminate("step", "exponential", recorded=pilot, workers=2, **FEW)
    assert swapped.table["first_nats"].tolist() == found.table["second_nats"].tolist()
    by_truth = swapped.sequential.iloc[::-1].reset_index(drop=True)
    assert by_truth.equals(found.sequential)


def test_the_record_of_sessions_is_drawn_written_and_read_like_that_of_tasks(found, tmp_path):
    sessions = found.axes()
    assert sessions["axis"].tolist() == ["session"] * 2
    assert sessions["value"].tolist() == ["a", "b"]
    assert found.table[["cells", "trials"]].to_numpy().tolist() == [[2, 50], [2, 50]]
    assert found.table["first_nats"].mean() == pytest.approx(found.sequential["nats"][0])
    assert "2 sessions, 4 cells, 100 recorded trials" in found.text()
    assert len(found.plot().axes) == 2
    again = bg.load(found.save(tmp_path / "found.npz"))
    assert again.to_json() == found.to_json()
    with refused("recorded"):
        found.experiment()


@pytest.mark.parametrize(
    ("options", "field"),
    [
        ({"second": "D7"}, "second"),
        ({"second": "macaque D7"}, "second"),
        ({"first": bg.load_circuit("macaque", 2)}, "first"),
        ({"second": "exponential"}, "second"),
        ({"second": None}, "second"),
        ({"space": Space()}, "space"),
        ({"second_edits": ["lesion STN 10%"]}, "second_edits"),
        ({"trials": 600}, "trials"),
        ({"pilots": 2}, "pilots"),
        ({"recorded": "striatum_clicks"}, "recorded"),
        ({"recorded": bg.read_trials("roitman_shadlen_2002", strength="coherence")}, "recorded"),
    ],
)
def test_what_cannot_be_compared_is_refused_in_one_sentence(options, field, pilot):
    asked = {"first": "exponential", "second": "step", "recorded": pilot} | options
    with refused(field):
        bg.discriminate(**asked)


def test_a_session_with_too_few_trials_is_refused_by_name(pilot):
    few = pilot.where(np.arange(100) < FEWEST_TRIALS - 1)
    with refused("recorded 49 of a"):
        bg.discriminate("exponential", "step", recorded=few)
