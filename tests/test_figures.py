"""The figures' rules hang together, and stored tables of scores show what they must."""

import os
import re
import sys
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from PIL import Image
from PIL.PngImagePlugin import PngInfo

from bgmodel import Msprt, stream
from bgmodel.comparison.thresholds import MSPRT, MSPRT_AT_GAIN
from bgmodel.deciding.tradeoff import tradeoff
from bgmodel.simulated_evidence import separated_evidence
from bgmodel.stopping.observer import StopMsprt, log_odds_of_stop
from bgmodel.support.files import read_table
from circuits.anatomy import DEFAULT
from figures import gallery, stamps
from figures.common import FAST, FULL
from figures.decisions import measure_calibrated as calibrated
from figures.decisions import measure_hick as hick
from figures.published_circuits import measure_others as others
from figures.rooms import rooms, table_path
from figures.stamps import KEY, Stamp, outdated, read_stamp, stamp_of
from figures.stopping import draw_G2 as figG2
from figures.stopping.observer import abrupt, commitments, decisions, observed, with_tone
from figures.stopping.runs import agreement, evidence_of
from tests.helpers import ROOT, program_run

SCRIPTS = sorted((ROOT / "figures").glob("*/draw_*.py"))


def dry_run(recordings):
    command = [sys.executable, "-m", "snakemake", "-s", "figures/Snakefile", "-n", "--cores", "1"]
    # Another folder for the figures would be asked for by an option; a dry run writes nothing.
    command += ["--forceall", "--nolock", "--config", "fast=1"]
    done = program_run(*command, cwd=ROOT, env=os.environ | {"BGMODEL_RECORDINGS": recordings})
    assert done.returncode == 0, done.stderr
    return done.stdout + done.stderr


def test_every_script_is_drawn():
    planned = dry_run("tests")
    for script in SCRIPTS:
        assert f"figures/fast/fig{script.stem.removeprefix('draw_')}.png" in planned


def stored(name):
    return read_table(table_path(name))


def test_simulated_experiments_have_the_predicted_medians_within_a_fifth():
    table = stored("discriminate_trials").dropna(subset="median")
    # Medians are whole numbers: one trial is within the error where few are needed.
    apart = (table["simulated_median"] - table["median"]).abs()
    near = (apart <= np.maximum(0.2 * table["median"], 1.0)).groupby(table["pair"]).all()
    assert near.sum() >= 3
    # A Bayes factor of 10 is wrong in at most 1 of 11 experiments, within 3 errors of 200 of them.
    assert (table["right"] > 1 - 1 / 11 - 3 * np.sqrt(10 / 11**2 / 200)).all()


def test_the_race_and_the_circuit_stop_at_one_place_and_common_input_moves_the_extra_channel():
    table, tone = stored("stopping_inhibition"), stored("stopping_tone")
    by = table.pivot(index="ssd_ms", columns="decider", values="p_respond")
    assert by["circuit, 1 nat"].to_numpy() == pytest.approx(by["race"].to_numpy(), abs=0.01)
    assert figG2.relative(table[table["decider"] == "circuit, 1 nat"]).is_monotonic_increasing
    by = tone.groupby("compared")["p_respond"].agg(np.ptp)
    assert by["circuit"] < 0.02 < 0.2 < by["extra channel"]


def test_regrets_are_small_where_reversals_are_known():
    table = stored("values_bandit")
    rows = table[(table["better"] == 0.8) & (table["reversals"] == "every 50")]
    assert rows.set_index("learner")["relative_regret"].drop(["ideal", "chance"]).min() < 1.35
    hazard = table[table["reversals"] == "hazard"]
    assert (hazard["relative_regret"] + 3 * hazard["relative_regret_se"].fillna(0) >= 1).all()


def test_times_fall_and_choices_improve_with_the_difference_of_values():
    for _, rows in stored("values_times").groupby("dopamine"):
        assert rows["share"].is_monotonic_increasing
        assert rows["median_ms"].is_monotonic_decreasing


WRITTEN = {name: each for room in rooms() for name, each in room.about.get("figures", {}).items()}
STAMP = Stamp("0.1", repr(FULL), {"LICENSE": "another file"})


def picture(path, stamp=STAMP, size=(1500, 300)):
    """Write a picture with a stamp."""
    text = PngInfo()
    if stamp:
        text.add_text(KEY, stamp.text())
    path.parent.mkdir(parents=True, exist_ok=True)
    Image.new("RGB", size, "white").save(path, pnginfo=text)
    return path


def test_the_gallery_shows_every_figure_once_and_says_which_are_missing(tmp_path):
    picture(tmp_path / "pictures" / "figC3.png")
    gallery.write(tmp_path)
    page = (tmp_path / "gallery.md").read_text(encoding="utf-8")
    parts = page.split("\n### ")[1:]
    assert len(parts) == len(WRITTEN)
    for name, text in WRITTEN.items():
        [part] = [part for part in parts if f"$ bgmodel figures {name}\n" in part]
        assert text["question"] in part
        shown = re.search(r"!\[(.+)\]\((.+)\)", part)
        assert (shown is not None) == (name == "figC3")
        assert ("no picture yet" in part) == (shown is None)
    assert "Drawn by version 0.1; different now: `LICENSE`." in page


def test_every_figure_has_a_small_picture_with_a_stamp_in_the_documentation():
    pictures = {path.stem: path for path in gallery.KEPT.glob("*.png")}
    assert pictures.keys() == WRITTEN.keys()
    assert sum(path.stat().st_size for path in pictures.values()) < 3.5e6
    assert [name for name, path in pictures.items() if read_stamp(path) is None] == []


def test_a_stamp_notices_a_changed_script_table_circuit_or_number(tmp_path, monkeypatch):
    read = table_path("loss_behaviour")
    stamp = stamp_of(ROOT / "figures/learning/draw_L4.py", [read, tmp_path / "own.parquet"], FULL)
    names = {"figures/learning/draw_L4.py", "figures/style.mplstyle"}
    assert stamp.sources.keys() == {*names, "figures/lesions/tables/loss_behaviour.csv", DEFAULT}
    assert stamp.changed() == []
    drawn = picture(tmp_path / "one.png", stamp)
    assert outdated(drawn, FULL) == ""
    assert "numbers of the run" in outdated(drawn, FAST)
    for name in stamp.sources:
        other = replace(stamp, sources=stamp.sources | {name: "0"})
        assert other.changed() == [name]
        assert f"`{name}`" in outdated(picture(tmp_path / "two.png", other), FULL)
    assert "not known" in outdated(picture(tmp_path / "three.png", None), FULL)


def test_words_in_a_script_change_no_stamp(tmp_path, monkeypatch):
    monkeypatch.setattr(stamps, "ROOT", tmp_path)
    script = tmp_path / "one.py"
    stamp = Stamp("0.1", "", {})
    script.write_text('"""A."""\n\n\ndef f():\n    """B."""\n    return 1  # C\n')
    stamp = replace(stamp, sources={"one.py": stamps._digest("one.py")})
    script.write_text('"""D."""\ndef f():\n    """E."""\n    return 1\n')
    assert stamp.changed() == []
    script.write_text("def f():\n    return 2\n")
    assert stamp.changed() == ["one.py"]


def gaussian(trials=3000, hypotheses=4):
    rng = stream(1, "alternatives")
    return separated_evidence(trials, 100, 0.5, rng=rng, hypotheses=hypotheses, step_ms=50)


def test_times_on_a_line_over_ln_n_give_it_back():
    counts = np.array([2, 4, 8, 16])
    ms = 100 + 300 * np.log(counts)
    rows = {"time_ms": ms, "time_ms_low": ms - 10, "time_ms_high": ms + 10, "accuracy": 0.95}
    nothing = {f"longer_ms{end}": np.nan for end in ("", "_low", "_high")}
    known = {"evidence": "Gaussian", "decider": "a", "alternatives": counts}
    (line,) = hick.lines(pd.DataFrame(rows | nothing | known)).to_dict("records")
    assert line["slope_ms"] == pytest.approx(300)
    assert line["intercept_ms"] == pytest.approx(100)
    assert line["pearson_r"] == pytest.approx(1)
    assert line["chi2_p"] == pytest.approx(1)


def test_a_decider_takes_no_longer_than_itself_and_a_later_one_by_what_it_is_late():
    evidence = gaussian()
    test = tradeoff(Msprt(0.5).run(evidence), evidence)
    late = replace(test, time_ms=test.time_ms + 70)
    rows = hick.at_accuracies({MSPRT: test, MSPRT_AT_GAIN: test, "late": late})
    known = rows.dropna(subset=["longer_ms"]).set_index("decider")["longer_ms"]
    assert known[MSPRT].to_numpy() == pytest.approx(0, abs=1e-5)
    assert known["late"].to_numpy() == pytest.approx(70, abs=1e-5)


@pytest.mark.parametrize(("sure", "kept"), [(1.0, True), (2.0, False)])
def test_errors_stay_below_what_a_criterion_allows_where_likelihoods_are_right(sure, kept):
    """Control: log-likelihoods that are twice the right ones."""
    evidence = gaussian()
    evidence = replace(evidence, log_likelihood=sure * evidence.log_likelihood)
    calibration = calibrated.criteria(evidence, np.arange(evidence.trials))
    assert (1 - calibration["accuracy"] <= 1 - calibration["criterion"]).all() == kept
    assert (calibration["excess_high"] >= 0).all() == kept


@pytest.mark.parametrize(
    ("sign", "low", "high", "outcome"),
    [
        (1, 2.1, 5, others.AGREES),
        (1, 1, 5, others.OPEN),
        (1, -3, 1, others.DISAGREES),
        (-1, -5, -2.1, others.AGREES),
        (-1, -1, 3, others.DISAGREES),
        (1, np.nan, np.nan, others.OPEN),
    ],
)
def test_a_change_is_as_expected_where_its_whole_interval_says_so(sign, low, high, outcome):
    assert others.outcome(others.ExpectedChange("mean_percent", sign, 2.0), low, high) == outcome


NONE = np.nan


def test_agreement_counts_outcomes_and_compares_times_of_those_that_responded_in_both():
    one = np.array([*np.arange(40.0), NONE, NONE])
    scores = agreement(one, np.append(one[:-1] - 3, 7.0))
    assert scores["same"] == pytest.approx(41 / 42)
    chance = (40 * 41 + 2 * 1) / 42**2
    assert scores["same_chance"] == pytest.approx(chance)
    assert scores["same_corrected"] == pytest.approx((41 / 42 - chance) / (1 - chance))
    assert (scores["times_r"], scores["times_ms"]) == (pytest.approx(1.0), pytest.approx(3.0))


def test_common_input_raises_s_and_changes_no_posterior():
    plain = evidence_of("tone", 20, 4)
    raised = with_tone(plain, 2.0)
    s = [np.logaddexp.reduce(each.own_totals[:, 40], axis=1) for each in (plain, raised)]
    assert s[1] - s[0] == pytest.approx(2.0)
    outs = [Msprt().run(each).out_nats for each in (plain, raised)]
    assert outs[0] == pytest.approx(outs[1])


def test_log_odds_jump_at_the_delay_and_add_what_is_wanted():
    go = evidence_of("tone", 10, 4)
    with_stops = abrupt(go, 800.0, float(np.log(np.expm1(1.0))))
    z = log_odds_of_stop(with_stops)
    assert z[:, 1:81] == pytest.approx(-30.0)
    assert z[:, 81:] == pytest.approx(z[0, 81])
    added = StopMsprt().run(with_stops).out_nats[..., :4] - Msprt().run(go).out_nats
    assert added[:, 90] == pytest.approx(1.0)


def test_the_observer_withholds_in_stop_trials_and_not_before_the_signal():
    go = evidence_of("observer", 200)
    ssd = np.full(200, 100.0)
    made = decisions(observed(go, ssd, 0.25, "stop", np.array([100.0])), 0.55)
    late = commitments(made, 2)
    assert np.isfinite(late).mean() > 0.9
    assert late.min() >= 100
