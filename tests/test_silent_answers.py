"""Calls that gave a misleading number in silence: each is refused or warned of."""

import numpy as np
import pandas as pd
import pytest

import bgmodel as bg
from bgmodel.experiments.predictions import Effect
from bgmodel.support.files import write_table
from bgmodel.tables.choices import read_choices
from bgmodel.tables.evidence import read_evidence_table
from bgmodel.tactile.source import read_decoded, source
from bgmodel.tactile.task import EdgeDirection
from circuits.errors import DataWarning, EditWarning, NoiseWarning
from tests.helpers import refused


def evidence(trials=120, **given):
    return bg.gaussian_evidence(trials, d_prime=0.8, t_max=40, seed=1, **given)


def test_biases_are_compensated_once():
    lost = bg.load_circuit("macaque").lesion("STN", 0.1)
    twice = lost.compensate().lesion("GPe", 0.05)
    with refused("reference circuit before all edits"):
        twice.compensate()
    whole = lost.lesion("GPe", 0.05).compensate()
    again = twice.compensate(bg.load_circuit("macaque"))
    for name in ("STN", "SNr"):
        assert again[name].bias_nats == pytest.approx(whole[name].bias_nats, abs=1e-6)


@pytest.mark.parametrize(("test", "given"), [
    (bg.Msprt(), {"threshold": 0.95}), (bg.Sprt(), {"threshold": 0.95}),
    (bg.Msprt(), {"posterior": 0.8, "prior": [0.1, 0.9]}),
])  # fmt: skip
def test_a_session_of_a_test_does_not_decide_before_evidence(test, given):
    with refused("threshold before its first reading"):
        test.session(2, **given)


def test_a_session_of_a_circuit_says_so_once():
    model = bg.BasalGanglia("macaque", "rate")
    session = model.session(posterior=0.6, prior=[0.9, 0.1], baseline=0.0)
    with pytest.warns(NoiseWarning, match="before its first reading"):
        session.add([0.0, -0.1])


@pytest.mark.parametrize(("given", "says"), [
    ({"taps": "nofile.csv"}, "taps does not use it"),
    ({"task": "same-different", "channels": 4}, "channels same-different has 2 alternatives"),
    ({"conflict": 5.0}, "conflict must be within"),
])  # fmt: skip
def test_evidence_is_drawn_from_settings_that_fit(given, says):
    with refused(says):
        bg.Stimuli(trials=50, **given).draw(0, "x")


def test_copies_of_trials_are_not_counted_as_new_in_silence():
    copied = evidence(60)[np.tile(np.arange(60), 2)]
    with pytest.warns(DataWarning, match="60 of 120 trials are copies"):
        bg.compare(bg.BasalGanglia("bogacz_gurney", "algebra"), copied, accuracies=0.8)


def test_models_that_need_a_zero_get_one():
    shifted = evidence()
    shifted = bg.Evidence(shifted.log_likelihood - 0.1, shifted.truth, step_ms=50, baseline=-0.1)
    with refused("baselines race needs evidence in which zero means no evidence"):
        bg.compare("macaque", shifted, baselines="race", accuracies=0.9)


def test_a_course_in_seconds_is_doubted():
    with pytest.warns(EditWarning, match="times are in ms"):
        bg.load_circuit("macaque").add("dopamine amount=0.2 from_ms=0.1 to_ms=0.3")


def test_a_change_in_fractions_of_a_percent_is_doubted():
    with pytest.warns(DataWarning, match="give -15 for -15 %"):
        Effect("mean_ms", -0.15, low=-0.2, high=-0.1, unit="percent", source="none")


def test_units_of_times_are_those_of_all_participants():
    rng = np.random.default_rng(3)
    table = pd.DataFrame({
        "participant_id": np.repeat(["a", "b", "c"], 100), "coh": rng.normal(size=300),
        "rt": rng.uniform(0.3, 1.5, 300), "response": rng.integers(0, 2, 300),
    })  # fmt: skip
    table.loc[table["participant_id"] == "b", "rt"] *= 1000
    with pytest.warns(DataWarning, match="are all of them in seconds"):
        read_choices(table, strength="coh")


def test_a_step_in_seconds_is_doubted(tmp_path):
    path = tmp_path / "mine.csv"
    rows = [(t, k, 0.1 * t, 0.0) for t in range(12) for k in range(3)]
    pd.DataFrame(rows, columns=["trial", "step", "ll_a", "ll_b"]).to_csv(path, index=False)
    with pytest.warns(DataWarning, match="is it in seconds"):
        read_evidence_table(path, step_ms=0.05)


def edges(count=600):
    true = np.linspace(-180, 180, count, endpoint=False)
    read = true + np.random.default_rng(4).normal(0, 15, count)
    return pd.DataFrame({"yaw_deg": true, "edge_deg": read})


def test_yaw_in_radians_is_doubted():
    with pytest.warns(DataWarning, match="radians"):
        source(np.radians(edges()), EdgeDirection(4, 5.0))


def test_copies_of_taps_are_doubted(tmp_path):
    path = tmp_path / "decoded.csv"
    write_table(pd.concat([edges(60)] * 5), path)
    with pytest.warns(DataWarning, match="240 of 300 taps are copies"):
        read_decoded(path)
