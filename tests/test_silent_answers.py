"""Calls that gave a misleading number in silence: each is refused or warned of."""

import re
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

import bgmodel as bg
from bgmodel.experiments.expected import Expected
from bgmodel.fitting.algorithms import GapModel
from bgmodel.fitting.design import design_of
from bgmodel.fitting.likelihood import likelihood_of
from bgmodel.fitting.person_fit import fit_likelihood
from bgmodel.fitting.sides import check_sides
from bgmodel.tactile.decoder import EDGE, Decoder, Training, train
from bgmodel.tactile.source import load_taps, source
from bgmodel.tactile.taps import warn_of_angles
from bgmodel.tactile.task import EdgeDirection, EdgeTurn
from bgmodel.trials.evidence_table import trials_from_table
from bgmodel.trials.reader import Columns, read_trials
from bgmodel.trials.task_trials import EvidenceTable, trials_of
from circuits.engines import run
from circuits.errors import DataWarning, EditWarning, NoiseWarning
from tests import read
from tests.helpers import doubting, refused, refusing, told, unwarned
from tests.tactile.recorded import edge_taps
from tests.tactile.striped import pushed_taps, striped_taps


def evidence(trials=120, **options):
    return bg.gaussian_evidence(trials, d_prime=0.8, t_max=40, seed=1, **options)


def edges(count=600, **changed):
    return edge_taps(count, 15, seed=4).assign(**changed)


@pytest.mark.parametrize("made", [pushed_taps, lambda *asked: striped_taps(*asked)])
def test_taps_for_training_are_doubted_as_those_for_decisions_are(made):
    pytest.importorskip("torch")
    taps = made(60, 1)
    training = Training(taps.stimulus, epochs=1, batch=8, width=0.05)
    with pytest.warns(DataWarning, match="60 of 120 taps are copies"):
        train(taps.select(np.tile(np.arange(60), 2)), seed=1, training=training)
    radians = replace(taps, labels=np.radians(taps.labels))
    with pytest.warns(DataWarning, match="radians"):
        train(radians, seed=1, training=training)
    assert not told(train, taps, seed=1, training=training)


@pytest.mark.parametrize(("asked", "column", "centre"), [
    (EdgeDirection(4, 5.0), "edge_deg", 90), (bg.SameDifferent(period_mm=3), "psi_deg", 0),
    (bg.Orientation(4, period_mm=3), "orientation_deg", 45),
])  # fmt: skip
def test_decoded_angles_that_do_not_follow_the_true_ones_are_doubted(asked, column, centre):
    taps = edges() if column == "edge_deg" else load_taps()
    assert not told(asked.pool, taps)
    here = taps if column == "edge_deg" else taps[taps["period_mm"] == 3]
    read = here[column]
    for wrong, says in (
        (np.radians(read), "radians"), (0.6 * np.radians(read), "radians"),
        (read / 360 + 0.5, "radians"), (centre - read, "mirrored"), (read / 2, "halved"),
    ):  # fmt: skip
        [text] = told(asked.pool, here.assign(**{column: wrong}))
        assert text.startswith(f"{column} must follow yaw_deg")
        assert says in text
    if column != "edge_deg":  # with the gratings that the decoder does not resolve
        [text] = told(asked.pool, taps.assign(**{column: centre - taps[column]}))
        assert "mirrored" in text


@pytest.mark.parametrize("yaws", [(-5, 5), (-2.5, 2.5), (0, 0), np.linspace(-30, 30, 7)])
@pytest.mark.parametrize("noise_deg", [0.0, 1.0, 40.0])
def test_small_angles_and_poor_decoders_are_not_doubted(yaws, noise_deg):
    true = np.tile(yaws, 60).astype(float)
    read = true + np.random.default_rng(8).normal(0, noise_deg, len(true))
    with unwarned():
        warn_of_angles(pd.DataFrame({"yaw_deg": true, "edge_deg": read}), "edge_deg")
    [text] = told(warn_of_angles, pd.DataFrame({"yaw_deg": np.radians(true + 7)}))
    assert "yaw_deg runs to" in text


def test_taps_that_jitter_about_the_yaws_of_a_task_are_doubted():
    task, taps = bg.SameDifferent(period_mm=3), load_taps()
    taps = taps[(taps["period_mm"] == 3) & taps["yaw_deg"].isin([-45, 45])]
    jitter = np.random.default_rng(9).normal(0, 0.02, len(taps))
    jittered = taps.assign(yaw_deg=taps["yaw_deg"] + jitter)
    used = [len(part) for part in task.pool(taps)]
    for text, yaw, count in zip(told(task.pool, jittered), (-45, 45), used, strict=True):
        assert f"within 0.01 degrees of {yaw}, as in" in text
        assert f"of the {count} taps" in text
    with unwarned():
        rounded = task.pool(jittered.assign(yaw_deg=jittered["yaw_deg"].round()))
        task.pool(taps.assign(yaw_deg=taps["yaw_deg"] + jitter / 10))
    assert [len(part) for part in rounded] == used


def test_angles_are_compared_where_they_are_decoded(monkeypatch):
    taps = pushed_taps(60, 1)
    decoder, yaw = Decoder(None, EDGE, taps.rest_mm, [], {}), taps.labels["yaw_deg"].to_numpy()
    for wrong, says in ((yaw, []), (np.radians(yaw), ["radians"]), (90 - yaw, ["mirrored"])):
        monkeypatch.setattr(Decoder, "_read", lambda *_: {"edge_deg": wrong, "strength": yaw})  # noqa: B023
        texts = told(decoder.decode, taps)
        assert [text.split()[-1] for text in texts] == says
    unlabelled = replace(taps, labels=taps.labels.drop(columns="yaw_deg"))
    assert not told(decoder.decode, unlabelled)


@pytest.mark.parametrize("column", ["yaw_deg", "edge_deg"])
@pytest.mark.parametrize("value", [np.nan, np.inf, "left"])
def test_a_tap_without_a_number_is_named(column, value):
    wrong = read.at(column, 7, value)(edges())
    for task in (EdgeDirection(4, 5.0), EdgeTurn(2, 5.0)):
        with refused(f"{column} .*1 are not: first row 7"):
            task.evidence(10, taps=wrong, seed=1)


def copied():
    return evidence(60)[np.tile(np.arange(60), 2)]


def shifted():
    return bg.Evidence(evidence().log_likelihood - 0.1, evidence().truth, baseline=-0.1)


def without_receptors():
    circuit = bg.load_circuit("spiking_msprt")
    for name in ("D1", "D2"):
        circuit = circuit.with_population(name, receptor="")
    return circuit


def biased_session():
    return bg.BasalGanglia("macaque", "rate").session(posterior=0.6, prior=[0.9, 0.1], baseline=0.0)


def padded(trials=60, steps=20):
    """Return readings of trials of several lengths, zeros after them, and the lengths."""
    rng = np.random.default_rng(5)
    values = rng.normal(size=(trials, steps, 2))
    lengths = rng.integers(5, steps + 1, trials)
    values[np.arange(steps) >= lengths[:, None]] = 0
    return values, lengths


def table_of(values):
    """Return readings as a user's table."""
    table = pd.DataFrame(values.reshape(-1, 2), columns=["ll_a", "ll_b"])
    trial, step = np.divmod(np.arange(len(table)), values.shape[1])
    return table.assign(trial=trial, step=step)


MACAQUE = bg.load_circuit("macaque")
LOW = MACAQUE.dopamine(0.9)
SHORT = evidence(100)[:4]
"""Trials of 40 readings, 50 ms each."""
TWICE = "already edited to a dopamine level of 0.9"


def delayed(from_ms):
    """Return a circuit with a course from some time on."""
    return bg.BasalGanglia(MACAQUE.add("dopamine", amount=0.2, from_ms=from_ms), "rate")


def driven(model):
    return run(model.circuit, model.drive(SHORT), engine="rate", step_ms=50)


test_what_is_probably_meant_otherwise_is_doubted = doubting(
    (DataWarning, "is it in seconds",
     lambda: trials_from_table(table_of(padded()[0]), step_ms=0.05)),
    (DataWarning, "is it in seconds", lambda: evidence(20, step_ms=0.05)),
    (DataWarning, "is it in seconds", lambda: replace(evidence(20), step_ms=0.05)),
    (DataWarning, "240 of 300 taps are copies", lambda: load_taps(pd.concat([edges(60)] * 5))),
    (DataWarning, "240 of 300 taps are copies", lambda: load_taps(
        pd.concat([edges(60)] * 5).assign(image=np.arange(300).astype(str)))),
    (None, "", lambda: load_taps(load_taps())),  # a few coincide, because they are rounded
    (DataWarning, "60 of 120 trials are copies", lambda: bg.compare(
        bg.BasalGanglia("bogacz_gurney", "algebra"), copied(), accuracies=0.8)),
    (DataWarning, "give -15 for -15 %", lambda: Expected(
        "mean_ms", value=-0.15, low=-0.2, high=-0.1, unit="percent", source="none")),
    (DataWarning, "radians", lambda: source(np.radians(edges()), EdgeDirection(4, 5.0))),
    (DataWarning, "radians", lambda: source(np.radians(edges() % 360), EdgeTurn(2, 5.0))),
    (DataWarning, "edge_deg .*radians", lambda: source(
        edges(edge_deg=np.radians(np.linspace(-180, 180, 600))), EdgeDirection(4, 5.0))),
    (DataWarning, "give the number of readings of each .lengths", lambda: bg.Evidence(padded()[0])),
    (None, "", lambda: bg.Evidence(padded()[0], lengths=padded()[1])),
    (DataWarning, "leave these rows out", lambda: trials_from_table(table_of(padded()[0]))),
    (NoiseWarning, "before its first reading", lambda: biased_session().add([0.0, -0.1])),
    (EditWarning, "times are in ms", lambda: MACAQUE.add(
        "dopamine", amount=0.2, from_ms=0.1, to_ms=0.3)),
    (EditWarning, "no row of spiking_msprt has a receptor",
     lambda: without_receptors().dopamine(0.8)),
    (EditWarning, TWICE, lambda: LOW.dopamine(0.8)),
    (EditWarning, TWICE, lambda: LOW.lesion("STN", 0.1).dopamine(0.8)),
    (EditWarning, TWICE, lambda: MACAQUE.edited("dopamine 0.9").dopamine(0.8)),
    (None, "", lambda: (LOW.dopamine(1), MACAQUE.dopamine(0.8))),
    (EditWarning, "since the longest trial ends 2050 ms", lambda: delayed(2100).run(SHORT)),
    (EditWarning, "since the longest trial ends 2050 ms",
     lambda: delayed(2100).decide(SHORT, posterior=0.8)),
    (EditWarning, "from 2100 to inf ms: no effect", lambda: driven(delayed(2100))),
    (None, "", lambda: (delayed(1900).run(SHORT), driven(delayed(1900)))),
)  # fmt: skip


test_what_would_give_a_misleading_number_is_refused = refusing(
    (lambda: bg.Msprt().session(2, threshold=0.95), "threshold before its first reading"),
    (lambda: bg.Sprt().session(2, threshold=0.95), "threshold before its first reading"),
    (lambda: bg.Msprt().session(2, posterior=0.8, prior=[0.1, 0.9]),
     "threshold before its first reading"),
    (lambda: bg.compare("macaque", shifted(), baselines="race", accuracies=0.9),
     "baselines race needs evidence in which zero means no evidence"),
    (lambda: bg.compare("macaque", evidence(), accuracies=[0.9, 0.9]), "accuracies must differ"),
)  # fmt: skip


def fed(session, evidence, *, sums):
    """Give a session the readings of all trials, or their running sums."""
    for readings in evidence.log_likelihood:
        for reading in readings.cumsum(axis=0) if sums else readings:
            if session.add(reading) is not None:
                break
        session.next()


@pytest.mark.parametrize("model", [bg.Msprt(), bg.Sprt()])
def test_a_session_doubts_running_sums(model):
    weak = bg.gaussian_evidence(60, d_prime=0.3, t_max=60, seed=2)
    with pytest.warns(DataWarning, match="correlate as running sums do") as caught:
        fed(model.session(2, posterior=0.9), weak, sums=True)
    assert len(caught) == 1


def choices(people=("a", "b"), trials=100):
    rng = np.random.default_rng(3)
    n = trials * len(people)
    strength = rng.choice([-0.4, -0.1, 0.1, 0.4], n)
    return pd.DataFrame({
        "participant_id": np.repeat(people, trials), "coh": strength,
        "rt": rng.uniform(0.3, 1.5, n).round(3),
        "response": (rng.random(n) < 0.5 + strength).astype(int),
    })  # fmt: skip


ROW = {"trial": 1, "step": 1, "ll_a": 0.0, "ll_b": 1.0}


@pytest.mark.parametrize("name", ["a ", " a", "a\u00a0"])
def test_names_differ_in_more_than_blanks(name):
    table = choices(("a", name))
    for column, reading in (
        ("participant_id", lambda: read_trials(table, strength="coh", participant="a")),
        ("cue", lambda: read_trials(
            table.rename(columns={"participant_id": "cue"}), strength="coh", conditions="cue")),
        ("response", lambda: read_trials(
            choices(("a",)).replace({"response": {1: "a", 0: name}}), columns=Columns(upper="a"))),
        ("participant_id", lambda: trials_from_table(
            pd.DataFrame({"participant_id": ["a", name], **ROW}))),
    ):  # fmt: skip
        with refused(f"{column} only in blanks"):
            reading()


test_names_that_differ_in_capitals_or_digits_are_doubted = doubting(
    *((DataWarning, "participant_id holds names that differ only in",
       lambda names=names: read_trials(choices(names), strength="coh"))
      for names in (("Left", "left"), ("007", "7"), ("1", "1.0"))),
    (None, "", lambda: read_trials(choices(("s1", "s10")), strength="coh")),
)  # fmt: skip


def test_biases_are_compensated_once():
    lost = bg.load_circuit("macaque").lesion("STN", 0.1)
    twice = lost.compensate().lesion("GPe", 0.05)
    with refused("reference circuit before all edits"):
        twice.compensate()
    at_once = lost.lesion("GPe", 0.05).compensate()
    again = twice.compensate(bg.load_circuit("macaque"))
    for name in ("STN", "SNr"):
        assert again[name].bias_nats == pytest.approx(at_once[name].bias_nats, abs=1e-6)


def test_few_times_of_one_participant_in_another_unit_are_doubted():
    few = choices(("a", "b", "c"))
    few = few[(few["participant_id"] != "b") | (few.index % 10 == 0)].iloc[:205].copy()
    few.loc[few["participant_id"] == "b", "rt"] *= 1000
    with pytest.warns(DataWarning, match="are all of them in seconds"):
        read_trials(few, strength="coh")


@pytest.mark.parametrize("share", [0.05, 0.3, 0.6])
@pytest.mark.parametrize("factor", [1000, 999])
def test_times_in_two_units_are_refused(share, factor):
    """A fit would need a grid of an hour, and excludes such times only if they are few."""
    table = choices(trials=200)
    some = np.arange(400) % 100 < 100 * share
    wrong = 1000 * table["rt"] if factor == 1000 else 999.0
    table["rt"] = np.where(some, wrong, table["rt"])
    with refused("rt must be in seconds"):
        read_trials(table, strength="coh")
    few = choices(trials=200)
    few.loc[:5, "rt"] = np.linspace(60, 70, 6)  # left to the window of the fit
    with unwarned():
        read_trials(few, strength="coh")


def test_responses_that_do_not_follow_the_strength_are_doubted():
    table = choices(("a",), trials=400)
    shuffled = table.assign(coh=table["coh"].sample(frac=1, random_state=1).to_numpy())
    for wrong in (shuffled, table.assign(coh=table["coh"] + 0.5)):  # without a sign
        with pytest.warns(DataWarning, match="no more often than by chance"):
            check_sides(read_trials(wrong, strength="coh"))


def test_strengths_with_the_sign_of_the_responses_are_doubted():
    table = choices(("a",), trials=200)
    signed = table.assign(coh=np.abs(table["coh"]) * (2 * table["response"] - 1))
    [text] = told(check_sides, read_trials(signed, strength="coh"))
    assert "each of 200 responses agrees" in text
    once = signed.assign(response=[1 - signed["response"][0], *signed["response"][1:]])
    for right in (table, once):
        texts = told(check_sides, read_trials(right, strength="coh"))
        assert not any("agrees" in each for each in texts)


def test_no_participant_is_pooled_with_the_other_side():
    table = choices(("a", "b", "c"))
    other = table["participant_id"] == "c"
    table["response"] = np.where(other, 1 - table["response"], table["response"])
    with refused("response c: responses must agree with the sign"):
        design_of(read_trials(table, strength="coh"), pooled=True)


def test_a_non_decision_time_above_a_second_is_doubted():
    monkey = read_trials("roitman_shadlen_2002", strength="coherence", participant="b")
    late = monkey.where(np.arange(monkey.trials) % 8 == 0)
    late = replace(late, rt_s=late.rt_s + 0.9)
    likelihood = likelihood_of(GapModel(), design_of(late))
    assert any("check that rt begins" in text for text in told(fit_likelihood, likelihood))


# Each pair has its own values.
@pytest.mark.parametrize(
    ("kind", "by", "matters"), [("pairs", "pair", False), ("stop signals", "ssd", True)]
)
def test_rows_out_of_the_order_of_presentation_are_doubted(kind, by, matters):
    table = read.table_of(kind, trial=np.tile(np.arange(24), 2))
    blocks = table.assign(trial=table["trial"] % 8)
    for right in (table, blocks, table.drop(columns="trial")):
        assert not told(read_trials, right)
    for wrong in (table[::-1], table.sample(frac=1, random_state=1), blocks[::-1]):
        [text] = told(read_trials, wrong)
        assert "in the order of presentation" in text
    texts = told(read_trials, table.sort_values([by, "participant_id", "trial"]))
    assert any("order of presentation" in text for text in texts) == matters


def test_a_table_of_evidence_is_read_again_if_it_changed_and_warned_of_once(tmp_path):
    path = tmp_path / "mine.csv"

    def written(trials):
        rng = np.random.default_rng(7)
        rows = [(k, step, *rng.uniform(0.1, 0.9, 2)) for k in range(trials) for step in range(3)]
        pd.DataFrame(rows, columns=["trial", "step", "ll_a", "ll_b"]).to_csv(path, index=False)

    written(60)
    task = EvidenceTable(path)
    [text] = told(lambda: (task.channels, trials_of(task, 0, "x"), trials_of(task, 0, "y")))
    assert "as probabilities do" in text
    prior = trials_of(task, 0, "x", prior=[0.9, 0.1]).evidence.prior
    np.testing.assert_array_equal(prior, [0.9, 0.1])
    written(61)
    assert task.trials == trials_of(task, 0, "x").evidence.trials == 61


def test_slow_trials_that_were_left_out_before_a_fit_are_asked_for():
    """The bound would be too low: without the slowest 10 %, 0.69 +- 0.01 instead of 0.85."""
    table = choices(("a",), trials=1500)
    table["rt"] = 0.3 + np.random.default_rng(4).wald(0.5, 1.0, 1500)
    made = read_trials(table, strength="coh")
    assert not told(design_of, made)
    for share in (0.02, 0.1, 0.3):
        end_s = float(np.quantile(made.rt_s, 1 - share))
        trimmed = made.where(made.rt_s <= end_s)
        [text] = told(design_of, trimmed)
        assert f"end abruptly at {trimmed.rt_s.max():.4g} s" in text
        assert not told(lambda: design_of(trimmed, rt_window=(0, end_s)))  # noqa: B023


@pytest.mark.parametrize("name", ["roitman_shadlen_2002", "palmer_huk_shadlen_2005"])
def test_published_choices_are_not_doubted(name):
    for who, one in read_trials(name, strength="coherence").by_participant().items():
        texts = told(design_of, one)
        assert not any(re.search("by chance|agrees|abruptly", text) for text in texts), who
