"""Tables from elsewhere: units, names and values that are refused, and others that are read."""

import pandas as pd
import pytest

from bgmodel.exam.exam import Exam
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
    seconds = TRIALS.assign(rt_s=TRIALS["rt_ms"] / 1000).drop(columns="rt_ms")
    read = read_tables(seconds, None, TASKS).trials_of("reference")
    assert read["rt_ms"].dropna().tolist() == [500, 700]
    with pytest.warns(DataWarning):
        read_tables(TRIALS.assign(rt_ms=0.5), None, TASKS)


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
