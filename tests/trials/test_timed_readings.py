"""Tables of trials and of their readings in all forms, and one sentence for each mistake."""

import numpy as np
import pandas as pd
import pytest

from bgmodel.fitting.known.trials import known_trials
from bgmodel.trials.reader import Columns, read_trials
from bgmodel.trials.timed_readings import readings_of
from circuits.errors import DataWarning
from tests.helpers import refused, refusing, told
from tests.known_trials import few
from tests.read import at, written


def tables(trials=None):
    """Return trials and readings with times, as users' tables."""
    trials = few(alternatives=2) if trials is None else trials
    response = [trials.names[k] for k in trials.choice]
    data = pd.DataFrame({"trial": trials.ids, "rt": trials.rt_s, "response": response})
    rows, readings = np.nonzero(np.isfinite(trials.time_s))
    evidence = pd.DataFrame({"trial": rows, "time": trials.time_s[rows, readings]})
    for k, name in enumerate(trials.names):
        evidence[f"ll_{name}"] = trials.log_likelihood[rows, readings, k]
    return data, evidence


def read_known(data, evidence, **options):
    return known_trials(read_trials(data, evidence=evidence, **options))


def test_readings_with_times_return_in_any_order_of_rows():
    trials = few(alternatives=2)
    data, evidence = tables(trials)
    again = read_known(data, evidence.sample(frac=1, random_state=1))
    np.testing.assert_array_equal(again.log_likelihood, trials.log_likelihood)
    np.testing.assert_array_equal(again.time_s, trials.time_s)
    np.testing.assert_array_equal(again.choice, trials.choice)
    assert again.names == trials.names


def test_steps_are_times_on_a_grid():
    data, evidence = tables()
    stepped = evidence.drop(columns="time").assign(step=evidence.groupby("trial").cumcount() + 1)
    first, second = read_known(data, evidence), read_known(data, stepped, step_ms=100.0)
    np.testing.assert_allclose(first.time_s, second.time_s)
    np.testing.assert_array_equal(first.log_likelihood, second.log_likelihood)


def test_files_keep_ids_as_they_are_written(tmp_path):
    data, evidence = tables()
    for table in (data, evidence):
        table["trial"] = [f"t{int(k):03d}" for k in table["trial"]]
    again = read_known(written(data, tmp_path / "t.csv"), written(evidence, tmp_path / "e.csv"))
    assert again.ids[3] == "t003"
    np.testing.assert_allclose(again.log_likelihood, few(alternatives=2).log_likelihood)


def test_clicks_favour_their_side_and_simultaneous_ones_are_one_reading():
    sides = ["left", "left", "right", "left"]
    clicks = pd.DataFrame({"trial": 1, "time": [0.2, 0.1, 0.2, 0.2], "side": sides})
    readings = readings_of(clicks)
    assert readings.names == ("left", "right")
    np.testing.assert_allclose(readings.time_s, [[0.1, 0.2]])
    np.testing.assert_allclose(readings.log_likelihood, [[[1, 0], [2, 1]]])
    worth = readings_of(clicks.assign(value=0.5))
    np.testing.assert_allclose(worth.log_likelihood, readings.log_likelihood / 2)


def test_signed_cues_favour_response_1():
    cues = pd.DataFrame({"trial": [1, 1], "time": [0.1, 0.2], "value": [0.8, -0.3]})
    readings = readings_of(cues)
    assert readings.names == ("0", "1")
    ratio = readings.log_likelihood[0, :, 1] - readings.log_likelihood[0, :, 0]
    np.testing.assert_allclose(ratio, [0.8, -0.3])


def test_participants_may_share_ids_of_trials():
    data, evidence = tables()
    two = pd.concat([data.assign(participant_id=p) for p in "ab"], ignore_index=True)
    one, other = (evidence.assign(participant_id=p) for p in "ab")
    by_person = pd.concat([one, other.assign(ll_a=2 * other["ll_a"])])
    for participant in (None, ["b", "a"]):
        assert read_trials(two, evidence=by_person, participant=participant).trials == len(two)
    first, second = (read_known(two, by_person, participant=p) for p in "ab")
    np.testing.assert_allclose(2 * first.log_likelihood[..., 0], second.log_likelihood[..., 0])
    assert read_known(two, by_person).who == "all"


def test_responses_1_and_0_need_a_name():
    data, evidence = tables()
    coded = data.assign(response=[int(r == "b") for r in data["response"]])
    again = read_known(coded, evidence, columns=Columns(upper="b"))
    np.testing.assert_array_equal(again.choice, read_known(data, evidence).choice)
    with refused("response"):
        read_known(coded, evidence)
    with refused("upper"):
        read_known(coded, evidence, columns=Columns(upper="c"))


def test_a_trial_without_a_response_is_kept():
    data, evidence = tables()
    data.loc[2, ["rt", "response"]] = [np.nan, None]
    again = read_known(data, evidence)
    assert again.choice[2] == -1
    assert again.seen[2] == 3


test_each_mistake_has_a_field = refusing(
    (lambda d, e: read_known(d, e[e["trial"] != 3]), "evidence"),
    (lambda d, e: read_known(pd.concat([d, d[:1]]), e), "trial"),
    (lambda d, e: read_known(d, e.assign(time=-e["time"])), "time"),
    (lambda d, e: read_known(d, e.assign(time=0.1)), "time"),
    (lambda d, e: read_known(d, e.assign(time=e["time"] + 60)), "time"),
    (lambda d, e: read_known(d, e.assign(time=1000 * (e["time"] - e["time"].min()))), "time"),
    (lambda d, e: read_known(d, e.assign(ll_a=np.inf)), "ll_a"),
    (lambda d, e: read_known(d, e.drop(columns="time")), "evidence"),
    (lambda d, e: read_known(d, e.drop(columns=["ll_a", "ll_b"])), "evidence"),
    (lambda d, e: read_known(d, e.assign(side="a").drop(columns=["ll_a", "ll_b"])), "side"),
    (lambda d, e: read_known(d, e.rename(columns={"time": "step"})), "step_ms"),
    (lambda d, e: read_known(d, e, step_ms=50.0), "step_ms"),
    (lambda d, e: read_known(d.drop(columns="trial"), e), "trial"),
    (lambda d, e: read_known(d.assign(response="z"), e), "response"),
    (lambda d, e: read_known(d.assign(rt=d["rt"] * 1000), e), "rt"),
    of=lambda reads: reads(*tables()),
)


def clicked(swapped, seed=1, trials=80):
    """Return trials of an observer who follows the clicks, or does the opposite."""
    rng = np.random.default_rng(seed)
    side = rng.integers(0, 2, (trials, 5))
    favoured = (side.sum(axis=1) > 2).astype(int) ^ swapped
    words = np.array(["left", "right"])
    data = pd.DataFrame({"trial": np.arange(trials), "rt": 0.9, "response": words[favoured]})
    place = np.indices(side.shape)
    clicks = {"trial": place[0].ravel(), "time": 0.1 * (1 + place[1].ravel())}
    return data, pd.DataFrame({**clicks, "side": words[side.ravel()]})


def test_responses_against_their_evidence_are_refused_and_those_by_chance_are_not():
    assert len(read_known(*clicked(0)).choice) == 80
    with refused("response against"):
        read_known(*clicked(1))
    data, clicks = clicked(0)
    read_known(data.assign(response=np.resize(["left", "right"], 80)), clicks)


def test_ids_are_text_as_written_and_blanks_are_refused(tmp_path):
    data, clicks = clicked(0)
    people = np.repeat(["01", "1"], 40)
    data = data.assign(participant_id=people, trial=np.arange(80) % 40)
    clicks = clicks.assign(participant_id=np.repeat(people, 5), trial=clicks["trial"] % 40)
    files = written(data, tmp_path / "trials.tsv"), written(clicks, tmp_path / "clicks.tsv")
    with pytest.warns(DataWarning, match="in how a number is written"):
        both = read_trials(files[0], evidence=files[1])
    assert [one.trials for one in both.by_participant().values()] == [40, 40]
    with refused("participant_id trials.*got nothing in row 3"):
        written(at("participant_id", 3, "")(data), files[0])
        read_trials(files[0], evidence=files[1])


def test_evidence_without_trials_warns():
    data, evidence = tables(few(40, alternatives=2))
    with pytest.warns(DataWarning):
        assert read_known(data[:30], evidence).trials == 30


def followed(trials, seed=2, alternatives=2):
    """Return trials in which choices follow the readings, as tables."""
    rng = np.random.default_rng(seed)
    told = rng.normal(0, 1.2, (trials, alternatives))
    odds = np.exp(told)
    shares = (odds / odds.sum(axis=1, keepdims=True)).cumsum(axis=1)
    names = np.array(["a", "b", "c"])
    data = pd.DataFrame({
        "trial": np.arange(trials), "rt": rng.uniform(0.4, 0.9, trials),
        "response": names[(rng.random(trials)[:, None] > shares).sum(axis=1)],
    })  # fmt: skip
    evidence = pd.DataFrame({"trial": np.arange(trials), "time": 0.1})
    return data, evidence.assign(**{f"ll_{names[k]}": told[:, k] for k in range(alternatives)})


@pytest.mark.parametrize("alternatives", [2, 3])
@pytest.mark.parametrize(("shift", "which"), [(1, "before"), (-1, "after")])
def test_ids_that_count_from_another_number_are_told_by_the_choices(alternatives, shift, which):
    """Of simulated tables of 60 trials, 98 % are told if shifted; of 1400 right ones, none is."""
    data, evidence = followed(120, alternatives=alternatives)
    middle = data[1:-1].sample(frac=1, random_state=1)
    assert not told(read_trials, data, evidence=evidence)
    with refused(f"trial the readings of the trial {which} their own"):
        read_trials(middle, evidence=evidence.assign(trial=evidence["trial"] - shift))
    with refused(f"evidence none for trial {119 if shift > 0 else 0}$"):
        read_trials(data, evidence=evidence.assign(trial=evidence["trial"] - shift))


def test_choices_that_follow_no_readings_are_doubted():
    data, evidence = followed(120)
    mixed = evidence.assign(trial=np.random.default_rng(1).permutation(120))
    (text,) = told(read_trials, data, evidence=mixed)
    assert "no more often than by chance" in text
    assert not told(read_trials, data[:30], evidence=mixed[mixed["trial"] < 30])  # too few
    # Trials without a response count for nothing, however many there are.
    for responses in (0, 40):
        few = data.astype({"response": object})
        few.loc[responses:, ["rt", "response"]] = np.nan, None
        assert not told(read_trials, few.assign(other=1), evidence=mixed)


def test_a_person_whose_readings_are_of_other_trials_is_named_by_the_users_column():
    data, evidence = followed(120)
    wrong = evidence.assign(trial=evidence["trial"] + 1).iloc[:-1]
    both = pd.concat([data.assign(vp="a"), data[1:].assign(vp="b")], ignore_index=True)
    rows = pd.concat([evidence.assign(vp="a"), wrong.assign(vp="b")], ignore_index=True)
    columns = Columns(participant="vp")
    with refused("trial participant b: .* the trial after their own"):
        read_trials(both, evidence=rows, columns=columns)
    rows = pd.concat([evidence.assign(vp="a"), evidence[1:].assign(vp="b")], ignore_index=True)
    assert read_trials(both, evidence=rows, columns=columns).trials == 239


def test_readings_that_all_come_after_the_responses_are_refused():
    data, evidence = followed(60)
    own = data.assign(rt=1000 * data["rt"])
    with refused("time first is at 100000 ms, the last response at"):
        read_trials(own, evidence=evidence.assign(time=100.0), columns=Columns(rt_unit="ms"))
    assert read_trials(own, evidence=evidence, columns=Columns(rt_unit="ms")).trials == 60


def test_advice_on_codes_is_given_for_codes_only():
    data, evidence = followed(60)
    coded = data.assign(response=np.where(data["response"] == "a", 1, 0))
    with refused("response upper"):
        read_trials(coded, evidence=evidence)
    with refused("response one of a, b, got 'A' in row \\d+ \\(\\d+ such rows\\)$"):
        read_trials(data.assign(response=data["response"].str.upper()), evidence=evidence)
