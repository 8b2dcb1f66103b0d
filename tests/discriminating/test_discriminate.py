"""Searches for the task that tells two models apart, against closed forms."""

from dataclasses import replace

import numpy as np
import pytest

import bgmodel as bg
from bgmodel.discriminating.discriminate import _within, same_rule
from bgmodel.discriminating.information import Recording
from bgmodel.discriminating.result import INSEPARABLE, SEPARABLE
from bgmodel.discriminating.space import Probe, Space
from bgmodel.discriminating.trials import PairedTrials
from bgmodel.experiments.models import model_of
from bgmodel.integrators.steady import out_shift
from circuits.declaration.table_writer import text
from circuits.errors import EditWarning, InputError
from tests.helpers import refused, refusing

FOUR = Space(
    channels=(4,), d_prime=(1.0,), accuracy=(0.95,), conflict=(0.0, 0.9), deadline_ms=(1000.0,)
)
TWO = replace(FOUR, channels=(2,))
HARD = replace(FOUR, d_prime=(0.05,), conflict=(0.0,))
FEW = {"trials": 400, "check_trials": 400}
LOSS = ["lesion STN 10%"]
QUICK = Space(d_prime=(1.0,), accuracy=(0.85,), deadline_ms=(1000.0,))


def test_whole_numbers_name_the_same_random_numbers_as_others():
    assert repr(Space(channels=(2.0, 4), d_prime=(1, 2))) == repr(
        Space(channels=(2, 4), d_prime=(1.0, 2.0))
    )


@pytest.fixture(scope="module")
def tests():
    return bg.discriminate("msprt", "max vs average", space=FOUR, trials=1000, check_trials=4000)


@pytest.fixture(scope="module")
def lesioned():
    """Return the search for what tells a loss of a tenth of STN from another threshold."""
    return bg.discriminate("macaque", second_edits=LOSS, space=QUICK, **FEW)


def test_two_alternatives_cannot_tell_the_msprt_from_max_vs_average():
    """Bogacz & Gurney 2007: with two alternatives they are one test."""
    verdict = bg.discriminate("msprt", "max vs average", space=TWO, **FEW)
    assert verdict.verdict == INSEPARABLE
    assert verdict.same == (2,)
    assert verdict.most_nats == 0
    # Their thresholds are matched to about a ten-thousandth.
    assert verdict.table["nats"].abs().max() < 1e-3
    assert verdict.sequential["median"].tolist() == [np.inf, np.inf]


def test_four_alternatives_can(tests):
    assert tests.verdict == SEPARABLE
    assert tests.same == ()
    assert tests.sequential["median"].between(10, 30).all()
    assert (tests.sequential["right"] > 0.85).all()
    ratio = tests.sequential["simulated_median"] / tests.sequential["median"]
    assert ratio.between(0.75, 1.33).all()


def test_rules_that_differ_are_not_one_rule():
    msprt, average, following = map(model_of, ("msprt", "max vs average", "max vs next"))
    assert same_rule(msprt, average, channels=2)
    assert same_rule(msprt, following, channels=2)
    assert not same_rule(msprt, average, channels=4)
    assert not same_rule(msprt, model_of("macaque"), channels=2)


def test_a_loss_of_stn_is_a_threshold_that_is_lower_by_its_logarithm(lesioned):
    """OUT falls by -ln(1 - f) at every S, so that a threshold lower by as much does the same."""
    assert lesioned.verdict == INSEPARABLE
    first, second = (way.levels[0] for way in lesioned.check.directions)
    assert first - second == pytest.approx(-np.log(0.9), abs=0.01)
    assert lesioned.most_nats < 0.003
    assert lesioned.sequential["low"].min() > 500


def test_a_loss_of_stn_is_one_threshold_at_every_log_odds_unless_the_law_of_gpe_changes():
    """Why a manipulation of dopamine or GPe can tell them apart, and nothing else can."""
    table, out = bg.load_circuit("macaque", 4), np.array([0.25, 0.4, 0.7, 1.0])
    shifts = {}
    for level in (0.95, 1.0, 1.05):
        before = table.edited(f"dopamine {level:g}") if level != 1 else table
        shift = out_shift(before, before.lesion("STN", 0.1), out)
        assert np.ptp(shift) < 1e-3
        shifts[level] = shift.mean()
    assert shifts[1.0] == pytest.approx(np.log(0.9), abs=1e-3)
    assert abs(shifts[0.95] - shifts[1.0]) > 0.005 < abs(shifts[1.05] - shifts[1.0])


def test_a_free_threshold_never_tells_more_than_a_matched_one():
    free = bg.discriminate("msprt", "max vs average", space=FOUR, thresholds="free", **FEW)
    matched = bg.discriminate("msprt", "max vs average", space=FOUR, **FEW)
    # Apart from the correction of the bias, which differs.
    assert free.table["nats"].max() < matched.table["nats"].max() + 0.02
    assert free.settings["thresholds"] == "free"


def test_a_free_non_decision_time_takes_what_a_delay_tells():
    class Late:
        """The MSPRT with a later response."""

        def run(self, evidence):
            trace = bg.Msprt().run(evidence)
            return replace(trace, time_ms=trace.time_ms + 100.0)

    plain = replace(FOUR, conflict=(0.0,))
    same = bg.discriminate("msprt", Late(), space=plain, non_decision="same", **FEW)
    free = bg.discriminate("msprt", Late(), space=plain, non_decision="free", **FEW)
    assert same.verdict == SEPARABLE
    assert free.verdict == INSEPARABLE
    assert [way.shift_ms for way in free.check.directions] == pytest.approx([-100, 100], abs=15)


def test_results_depend_neither_on_workers_nor_on_the_order_of_models(lesioned):
    again = bg.discriminate("macaque", second_edits=LOSS, space=QUICK, workers=2, **FEW)
    assert again.to_json() == lesioned.to_json()
    swapped = bg.discriminate("macaque", "macaque", first_edits=LOSS, space=QUICK, **FEW)
    assert swapped.table["first_nats"].tolist() == lesioned.table["second_nats"].tolist()


def test_the_experiment_of_the_best_task_reads_back_and_runs(lesioned):
    planned = lesioned.experiment()
    again = bg.Experiment.from_text(planned.to_toml())
    assert again == planned
    assert planned.seed not in (lesioned.settings["seed"], lesioned.settings["check_seed"])
    control, manipulation = planned.conditions
    assert manipulation.threshold_nats < control.threshold_nats
    outcome = replace(planned, task=replace(planned.task, trials=200)).run()
    change = outcome.measures.query("condition == 'change' and measure == 'accuracy'")
    assert change["low"].item() <= 0 <= change["high"].item()


def asking(first, second=None, **options):
    return lambda: bg.discriminate(first, second, **options)


test_what_cannot_be_searched_is_refused = refusing(
    (asking("macaque"), "second"),
    (asking("msprt", "msprt"), "second"),
    (asking("macaque", second_edits=["scale D1->SNr 1"]), "second"),
    (asking("gpr", "macaque"), "unit"),
    (asking("nobody"), "circuit"),
    (asking("msprt", second_edits=LOSS), "edits"),
    (asking("macaque", "msprt", thresholds="none"), "thresholds"),
    (asking("macaque", "msprt", non_decision="none"), "non_decision"),
    (asking("macaque", "msprt", trials=10), "trials"),
    (asking("macaque", "msprt", seed=99_201), "check_seed"),
    (asking("macaque", "msprt", recording=Recording("STN")), "nucleus"),
    (asking("msprt", "max vs average", space=HARD, **FEW), "space"),
)


def test_a_manipulation_that_a_circuit_does_not_have_is_left_out_with_a_warning():
    without = replace(QUICK, edits=("", "lesion TRN 5%"))
    with pytest.warns(bg.BgmodelWarning):
        result = bg.discriminate("macaque", second_edits=LOSS, space=without, **FEW)
    assert result.settings["left_out"] == ["lesion TRN 5%"]


def test_both_models_have_the_accuracy_of_the_task_in_plain_trials():
    models = model_of("macaque"), model_of("macaque", ["lesion GPe 5%"])
    trials = PairedTrials(models, QUICK, 5, 2000)
    probe = Probe(2, 1.0)
    for k in (0, 1):
        [level] = trials.levels(k, probe).values()
        decisions = trials.simulated(k, probe).at(level, 1e9)
        assert (decisions.choice == 0).mean() == pytest.approx(0.85, abs=0.025)


def test_the_map_the_figure_and_the_report_name_the_best_task(tests):
    axes = tests.axes()
    best = axes[axes["axis"] == "conflict"].sort_values("low")["value"].iloc[-1]
    assert f"conflict {best}" in tests.check.design.text() or best == "0"
    assert len(tests.plot().axes) == 2
    assert tests.check.design.text() in tests.text()
    with refused("second"):  # no test can be planned as an experiment
        tests.experiment()


def test_numbers_of_alternatives_that_a_file_does_not_have_are_left_out(tmp_path):
    """A circuit in a file has one; without any the error of the file remains."""
    path = tmp_path / "mine.toml"
    path.write_text(text(bg.load_circuit("macaque", 2).scale("STN->SNr", 0.8)), encoding="utf-8")
    models = model_of("macaque", ()), model_of(path, ())
    space = Space(channels=(2, 4), d_prime=(1.0,), accuracy=(0.8,))
    with pytest.warns(EditWarning, match="4 alternatives"):
        kept, left_out = _within(space, models)
    assert kept.channels == (2,)
    assert left_out == ["channels 4"]
    with pytest.raises(InputError):
        _within(replace(space, channels=(4,)), models)
