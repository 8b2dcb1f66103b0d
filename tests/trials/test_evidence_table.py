"""A user's table of evidence: read unchanged, or rejected with an explanation."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from bgmodel import Msprt, first_crossing
from bgmodel.deciding.calibration import warn_of_units
from bgmodel.evidence import Evidence
from bgmodel.simulated_evidence import separated_evidence
from bgmodel.support.files import write_table
from bgmodel.support.seeds import stream
from bgmodel.tactile.task import Orientation, SameDifferent
from bgmodel.trials.evidence_table import read_evidence_table, trials_from_table
from bgmodel.trials.named_evidence import trial_table
from circuits.errors import CalibrationWarning, DataWarning
from tests.helpers import doubting, long_table, refused, unwarned
from tests.read import at, changed, without, written

SMALL = separated_evidence(7, 4, 1.0, rng=stream(1, "tables"))
THREE = separated_evidence(7, 4, 1.0, rng=stream(1, "tables"), hypotheses=3)


def test_a_users_table_gives_back_the_evidence():
    # Trials in their order, the rows of each in any.
    shuffled = long_table(THREE).sample(frac=1, random_state=3)
    back = trials_from_table(shuffled.sort_values("trial", kind="stable"))
    assert back.names == ["a", "b", "c"]
    assert np.array_equal(back.evidence.log_likelihood, THREE.log_likelihood)
    assert np.array_equal(back.evidence.truth, THREE.truth)
    assert trials_from_table(long_table(THREE, truth=False)).evidence.truth is None
    assert back.summary() == "read 7 trials of 4 readings, hypotheses a, b, c"


IDS = {
    "mixed": ["a", 1, 2.5, (3, 4), "1", -7, "b c"],
    "dates": list(pd.date_range("2026-01-01", periods=7)),
    "truths": [True, False, "yes", "no", 1.5, 2.5, 3.5],
}


@pytest.mark.parametrize("kind", IDS)
def test_trial_ids_of_any_kind_come_back_in_the_order_of_the_table(kind):
    table = long_table(THREE)
    ids = pd.Series(IDS[kind], dtype=object if kind in ("mixed", "truths") else None)
    table["trial"] = np.array(ids, dtype=object)[table["trial"]]
    table["trial"] = table["trial"].astype(ids.dtype)
    back = trials_from_table(table)
    assert list(back.columns["trial"]) == list(ids)
    assert np.array_equal(back.evidence.log_likelihood, THREE.log_likelihood)
    decided = trial_table(first_crossing(Msprt().run(back.evidence), 0.2), back, model="m")
    assert list(decided["trial"]) == list(ids)
    assert decided["row"].tolist() == [0, 4, 8, 12, 16, 20, 24]


def ragged(rng, trials=40, most=9):
    """Return a table of unequal trials with ids, participants and other columns, and lengths."""
    lengths, number = rng.integers(1, most + 1, trials), np.arange(trials)
    each = pd.DataFrame({"trial": number // 2, "block": number // 10})
    each["participant_id"] = np.where(number % 2, "s02", "s01")
    each["truth"] = rng.choice(["left", "right"], trials)
    each["condition"] = rng.choice(["easy", "hard"], trials)
    each["rt"] = rng.gamma(2, 0.3, trials)
    table = each.loc[np.repeat(number, lengths)].reset_index(drop=True)
    table["step"] = table.groupby(["participant_id", "trial"]).cumcount() + 1
    within = ("ll_left", "ll_right", "eye_x")
    return table.assign(**{name: rng.normal(size=len(table)) for name in within}), lengths


def test_a_users_columns_come_back_and_the_result_joins_by_id_and_by_row():
    table, lengths = ragged(np.random.default_rng(5))
    table = table.sample(frac=1, random_state=2).reset_index(drop=True)
    trials = trials_from_table(table, step_ms=50.0)
    assert trials.varying == ["eye_x"]
    decided = trial_table(first_crossing(Msprt().run(trials.evidence), 0.3), trials, model="m")
    assert sorted(trials.evidence.readings) == sorted(lengths)
    keys = ["participant_id", "trial"]
    first = table.groupby(keys, sort=False, as_index=False).first()
    joined = first.merge(decided, on=keys, suffixes=("", "_ours"), validate="one_to_one")
    assert len(joined) == len(decided) == 40
    names = {"given_rt": "rt", "condition_ours": "condition", "block_ours": "block"}
    for ours, theirs in (names | {"stimulus": "truth"}).items():
        assert (joined[ours] == joined[theirs]).all()
    by_row = table.iloc[decided["row"]].reset_index(drop=True)
    assert (by_row[keys] == decided[keys]).all(axis=None)
    assert "eye_x" not in decided


NUMBERS = ["7 8 -9", "0.5 2.0 -3.25"]
TEXT = ["007 8 9", "1.50 2.5 3", "NA nan NULL", "1  3", "99999999999999999999 1 2", "1e5 2 3"]
TEXT += ["-1 9223372036854775809 2", "True False True"]


@pytest.mark.parametrize("written", [*NUMBERS, *TEXT])
def test_cells_of_a_csv_come_back_as_they_were_written(tmp_path, written):
    path, cells = tmp_path / "mine.csv", written.split(" ")
    rows = [f"{k},0,-1,-2,{cell}" for k, cell in enumerate(cells)]
    path.write_text("\n".join(["trial,step,ll_a,ll_b,tag", *rows]))
    trials = read_evidence_table(path)
    assert (trials.columns["tag"].dtype == object) == (written in TEXT)
    decided = trial_table(first_crossing(Msprt().run(trials.evidence), 0.1), trials, model="m")
    write_table(decided, tmp_path / "out.csv")
    again = pd.read_csv(tmp_path / "out.csv", dtype=str, keep_default_na=False)
    assert again["tag"].tolist() == cells


def test_the_ending_of_a_file_says_how_it_is_read_and_numbers_are_the_same(tmp_path):
    """Readings are 1 ms apart by default."""
    table = long_table(SMALL)
    known = trials_from_table(table)
    for ending in (".csv", ".tsv", ".parquet"):
        path = written(table, tmp_path / f"mine{ending}")
        evidence = read_evidence_table(path).evidence
        np.testing.assert_array_equal(evidence.log_likelihood, known.evidence.log_likelihood)
        assert (evidence.onset_ms, evidence.step_ms) == (0, 1)
        later = read_evidence_table(path, onset_ms=20.0, step_ms=50.0, prior=[0.25, 0.75]).evidence
        assert (later.onset_ms, later.step_ms) == (20, 50)
        assert later.prior.tolist() == [0.25, 0.75]
    assert (known.evidence.onset_ms, known.evidence.step_ms) == (0, 1)
    assert known.evidence.baseline == known.evidence.mean_reading


def test_a_million_nats_are_the_most_that_a_reading_says():
    table = long_table(SMALL)
    at = np.arange(len(table))
    most = table.assign(ll_a=np.where(at == 3, 1e6, -1e6))
    assert np.ptp(trials_from_table(most).evidence.log_likelihood[..., 0]) == 2e6
    for beyond in (1.000001e6, -1.000001e6):
        with refused("ll_b must be .* at trial 1, step 1"):
            trials_from_table(table.assign(ll_b=np.where(at == 5, beyond, 0.0)))


BAD = {
    "columns needs the columns trial, step": without("step"),
    "columns at least two ll_": without("ll_a"),
    "step trial 0 has step 0 twice": lambda good: pd.concat([good, good.head(1)]),
    "step trial 0 starts with 1": lambda good: good.iloc[1:],
    "step trial 0 goes from 0 to 2": lambda good: good.drop(index=1),
    "step must be a whole number, got 0.5": changed(step=0.5),
    "step must be a whole number, got late": changed(step="late"),
    "step every trial: trial 0 starts with 2": changed(step=lambda good: good["step"] + 2),
    "trial is missing in row 4": at("trial", 4, np.nan),
    "ll_a must be a finite number within .* got 'abc' at trial 0, step 1": at("ll_a", 1, "abc"),
    r"ll_b must be .* got 'nan' at trial 0, step 0 \(28 such": changed(ll_b=np.nan),
    r"truth must be one of .* first 'z' in row 0 \(28 such rows\)": changed(truth="z"),
    "truth first 'z' in row 9": at("truth", 9, "z"),
    "truth got several in one trial, first 'b' in row 1": lambda good: at("truth", 1, "b")(
        good.assign(truth="a")
    ),
    **{
        f"columns {name!r} is not a hypothesis": changed(**{name: 0.0})
        for name in ("ll_", " ll_c", "ll_c ", "ll_ c", "LL_c", "ll-c", "Ll c")
    },
    "truth 'Truth' is not 'truth'": changed(Truth="a"),
    "trial 'trial ' is not 'trial'": changed(**{"trial ": 1}),
    "columns the column row is reserved for results": changed(row=1),
    "ll_a must hold numbers, got bool": changed(ll_a=True),
    "step must hold numbers, got datetime64": changed(step=pd.Timestamp("2026-01-01")),
    "columns the column rt is reserved for results": changed(rt=1, given_rt=2),
    "truth must be one of .* got .'1.0', 'nan'": changed(
        truth=lambda good: np.where(good["trial"] == 0, np.nan, 1.0)
    ),
    "note column 'note' can't be compared": lambda good: good.assign(note=[[1]] * len(good)),
}


@pytest.mark.parametrize("says", BAD)
def test_bad_tables_get_one_clear_sentence(says):
    trials_from_table(long_table(SMALL))
    with refused(says):
        trials_from_table(BAD[says](long_table(SMALL)))


def test_the_cells_of_a_csv_are_refused_as_those_of_a_table(tmp_path):
    path = tmp_path / "mine.csv"
    for row, says in (
        ('0,0,"-1,5",2', "ll_a mine.csv.*got '-1,5'.*decimal sign a comma"),
        ("0,0,1,", "ll_b mine.csv.*must be a finite number"),
        ("0,0,1,inf", "ll_b mine.csv.*must be a finite number"),
        (",0,1,2", "trial mine.csv.*missing in row 0"),
    ):
        path.write_text(f"trial,step,ll_a,ll_b\n{row}\n")
        with refused(says):
            read_evidence_table(path)


def test_the_same_trial_number_of_two_participants_is_two_trials():
    table, _ = ragged(np.random.default_rng(5))
    assert trials_from_table(table).evidence.trials == 40
    with refused(r"step has step 1 twice \(two participants\? give part"):
        trials_from_table(table.drop(columns="participant_id"))


def test_a_table_too_large_says_what_it_needs():
    table = pd.DataFrame({"trial": np.arange(200_000), "step": 0, "ll_a": 0.0, "ll_b": 0.0})
    long = pd.DataFrame({"trial": -1, "step": np.arange(2_000_000), "ll_a": 0.0, "ll_b": 0.0})
    with pytest.raises(ValueError, match="200001 trials of up to 2000000 readings need"):
        trials_from_table(pd.concat([table, long]))


THIRTY = long_table(separated_evidence(30, 12, 0.5, rng=4))
AGAIN = THIRTY[THIRTY["trial"] < 7].assign(trial=lambda rows: rows["trial"] + 1000)
BINARY = Evidence(stream(4, "binary").choice([-0.4, 0.4], (200, 3, 2)))
MANY = separated_evidence(2000, 30, 0.4, rng=5)
OPPOSITE = "tell nothing of the truth or contradict it"

# Trials alike by chance are not doubted. Evidence against the truth has no unit: no positive factor
# mends it.
test_tables_that_mislead_are_doubted = doubting(
    (DataWarning, "7 of 37 trials", lambda: trials_from_table(pd.concat([THIRTY, AGAIN]))),
    (None, "", lambda: trials_from_table(THIRTY)),
    (None, "", lambda: trials_from_table(long_table(BINARY, truth=False))),
    (CalibrationWarning, OPPOSITE, lambda: trials_from_table(
        long_table(replace(MANY, log_likelihood=-MANY.log_likelihood)))),
    (CalibrationWarning, OPPOSITE, lambda: trials_from_table(
        long_table(replace(MANY, truth=np.roll(MANY.truth, 1))))),
)  # fmt: skip


@pytest.mark.parametrize("channels", [2, 3])
@pytest.mark.parametrize(("unit", "nats"), [("log2", np.log(2)), ("log10", np.log(10))])
def test_logarithms_to_another_base_are_told_by_the_truth(channels, unit, nats):
    evidence = separated_evidence(2000, 30, 0.4, rng=5, hypotheses=channels)
    other = replace(evidence, log_likelihood=evidence.log_likelihood / nats)
    with pytest.warns(CalibrationWarning, match=f"those of {unit} times"):
        trials_from_table(long_table(other))
    with unwarned():
        trials_from_table(long_table(other, truth=False))
        trials_from_table(long_table(evidence))


def test_natural_logarithms_are_never_taken_for_others():
    """The z score of each table is at most 3.29 in all but one of a thousand."""
    with unwarned():
        for seed in range(200):
            many = {"rng": seed, "hypotheses": 2 + seed % 3}
            for trials, separation in ((40, 0.35), (200, 1.5)):
                warn_of_units(separated_evidence(trials, 30, separation, **many))
        for task in (SameDifferent(), Orientation(2)):
            warn_of_units(task.evidence(1000, seed=stream(0, "taps")))


def test_a_table_of_running_sums_is_doubted_once():
    told = ["ll_a", "ll_b"]
    table = THIRTY.assign(**THIRTY.groupby("trial")[told].cumsum())
    with pytest.warns(DataWarning, match="correlate") as caught:
        trials_from_table(table)
    assert len(caught) == 1
