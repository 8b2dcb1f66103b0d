"""Tables from elsewhere: units, names and values that are refused, and others that are read."""

import numpy as np
import pandas as pd
import pytest

from bgmodel.exam.exam import Exam
from bgmodel.exam.measures import MEASURES, Results
from bgmodel.exam.tables import NotApplicable, read_tables
from circuits.errors import DataWarning
from tests.helpers import refusing

TASKS = Exam.shipped().tasks
TRIALS = pd.DataFrame({"task": "reference", "rt_ms": [500.0, 700.0, None], "correct": [1, 0, None]})
RATES = pd.DataFrame({"task": "rest", "nucleus": "STN", "window": "rest", "rate_hz": [12.0, 18.0]})


test_bad_tables_are_refused_by_their_column = refusing(
    ((None, None), "trials"),
    ((TRIALS.rename(columns={"rt_ms": "rt"}), None), "rt_ms"),
    ((TRIALS.drop(columns="rt_ms"), None), "rt_ms"),
    ((TRIALS.assign(rt_s=1.0), None), "rt_s"),
    ((TRIALS.drop(columns="task"), None), "task"),
    ((TRIALS.assign(task="nap"), None), "task"),
    ((TRIALS.assign(correct=0.5), None), "correct"),
    ((TRIALS.assign(rt_ms="soon"), None), "rt_ms"),
    ((TRIALS.assign(rt_ms=float("inf")), None), "rt_ms"),
    ((TRIALS.assign(rt_ms=[500.0, 700.0, -1.0]), None), "rt_ms"),
    ((TRIALS.assign(rt_ms=[500.0, 700.0, 0.0]), None), "rt_ms"),
    ((TRIALS.assign(ssd=200.0), None), "ssd_ms"),
    ((TRIALS.assign(ssd_ms=-1.0), None), "ssd_ms"),
    ((TRIALS.assign(ssd_ms=200.0, ssd_s=0.2), None), "ssd_s"),
    ((TRIALS.assign(deadline=2000.0), None), "deadline_ms"),
    ((TRIALS.assign(correct=[1, 0, 0]), None), "correct"),
    ((TRIALS.assign(trial=1), None), "trial"),
    ((None, RATES.rename(columns={"rate_hz": "rate"})), "rate_hz"),
    ((None, RATES.assign(window="noon")), "window"),
    ((None, RATES.assign(role="boss")), "role"),
    ((None, RATES.assign(task="nap")), "task"),
    ((None, RATES.drop(columns="nucleus")), "nucleus"),
    ((None, RATES.assign(rate_hz=-1.0)), "rate_hz"),
    ((None, RATES.assign(rate_hz=2000.0)), "rate_hz"),
    ((None, RATES.assign(sd_hz=1.0)), "trials"),
    ((None, RATES.assign(trials=30)), "sd_hz"),
    ((None, RATES.assign(sd_hz=-1.0, trials=30)), "sd_hz"),
    ((None, RATES.assign(sd_hz=1.0, trials=1)), "trials"),
    ((None, RATES.assign(sd_hz=1.0, trials=30, trial=1)), "trial"),
    of=lambda tables: read_tables(tables[0], tables[1], TASKS),
)


def test_seconds_are_read_as_such_and_suspected_in_ms():
    seconds = TRIALS.assign(rt_s=TRIALS["rt_ms"] / 1000, ssd_s=0.2, deadline_s=2)
    read = read_tables(seconds.drop(columns="rt_ms"), None, TASKS).trials_of("reference")
    assert read["rt_ms"].dropna().tolist() == [500, 700]
    assert read[["ssd_ms", "deadline_ms"]].to_numpy().tolist() == [[200, 2000]] * 3
    for wrong in ({"rt_ms": 0.5, "correct": 1}, {"ssd_ms": 0.2}, {"deadline_ms": 2}):
        with pytest.warns(DataWarning, match="if it is in s"):
            read_tables(TRIALS.assign(**wrong), None, TASKS)


@pytest.mark.parametrize("sums", [False, True])
def test_rows_without_numbers_of_trials_are_no_pairs(sums):
    """The difference of two means has both their variances, in whatever order the rows are."""
    rising = np.sort(np.random.default_rng(1).normal(20, 3, 400))
    sd = rising.std(ddof=1)
    one = RATES[:1].assign(sd_hz=sd, trials=400) if sums else RATES.loc[[0] * 400]
    one = one if sums else one.assign(rate_hz=rising)
    rates = pd.concat([one, one.assign(task="rest, dopamine loss")])
    trials = TRIALS.loc[[0] * 400].assign(rt_ms=10 * rising)
    trials = pd.concat([trials, trials.assign(task="stimulation")])
    tables = Results(read_tables(trials, rates, TASKS), TASKS, 1)
    of = {"task": "rest, dopamine loss", "minus_task": "rest"}
    rate = MEASURES["rate_change"](tables, "STN", "rest", **of)
    assert rate.se == pytest.approx(sd * np.sqrt(2 / 400))
    time = MEASURES["time_change"](tables, "stimulation", "reference")
    assert time.se == pytest.approx(10 * sd * np.sqrt(2 / 400), rel=0.15)


def test_the_populations_of_a_nucleus_are_averaged(tmp_path):
    both = pd.concat([RATES.assign(nucleus="D1"), RATES.assign(nucleus="D2", rate_hz=[2.0, 4.0])])
    both.to_csv(tmp_path / "rates.csv", index=False)
    tables = read_tables(None, tmp_path / "rates.csv", TASKS)
    assert tables.rates_of("rest", "MSN", "rest", "all").tolist() == [7, 11]
    assert tables.rates_of("rest", "D1", "rest", "all").tolist() == [12, 18]
    for place in (("rest", "STN", "rest", "all"), ("rest", "MSN", "late", "all")):
        with pytest.raises(NotApplicable):
            tables.rates_of(*place)
    with pytest.raises(NotApplicable):
        tables.trials_of("reference")


def test_a_row_that_sums_up_trials_has_their_mean_and_standard_deviation():
    one = RATES[:1].assign(sd_hz=3.0, trials=40)
    rates = read_tables(None, one, TASKS).rates_of("rest", "STN", "rest", "all")
    assert (len(rates), rates.mean()) == (40, pytest.approx(12.0))
    assert rates.std(ddof=1) == pytest.approx(3.0)
    odd = read_tables(None, one.assign(trials=41), TASKS).rates_of("rest", "STN", "rest", "all")
    assert (len(odd), odd.mean()) == (40, pytest.approx(12.0))
