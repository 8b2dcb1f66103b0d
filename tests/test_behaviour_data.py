"""Import of the built-in data sets: signs and codes are checked against the choices."""

import numpy as np
import pandas as pd

from benchmarks import behaviour_data
from bgmodel.support.files import read_provenance


def motion_file(trials=200):
    rng = np.random.default_rng(2)
    signed = rng.choice([-0.512, -0.0, 0.512], trials)
    choice = (rng.random(trials) < 0.5 + 0.9 * signed).astype(int)
    correct = np.where(signed == 0, np.nan, (choice == (signed > 0)).astype(float))
    rows = {"participant_id": "01", "trial": np.arange(trials), "rt": rng.uniform(0.3, 1, trials)}
    return pd.DataFrame({**rows, "choice": choice, "signed_coherence": signed, "correct": correct})


def pairs_file():
    stim = np.tile(["LL", "WW", "WL", "WL"], 50)
    high = stim != "WL"
    better = np.where(np.arange(200) % 10 < np.where(high, 6, 8), 1.0, 0.0)
    rows = {"subj_idx": np.repeat([0, 1], 100), "stim": stim, "rt": 1.25, "response": better}
    more = {"theta": 0.5, "dbs": np.arange(200) // 4 % 2, "conf": np.where(high, "HC", "LC")}
    return pd.DataFrame({**rows, **more})


def stop_file():
    trials = np.arange(200)
    rows = {"participant_id": "01", "trial": trials + 1, "stimulus": "left"}
    kind = np.where(trials % 4 == 0, "stop", "go")
    made = trials % 8 != 0
    rt, ssd = np.where(made, 0.5, np.nan), np.where(kind == "stop", 0.2, np.nan)
    more = {"trial_type": kind, "response": np.where(made, "left", None)}
    return pd.DataFrame({**rows, **more, "rt_s": rt, "ssd_s": ssd})


def simon_file():
    trials = np.arange(200)
    test, made = trials >= 150, trials % 10 != 0
    correct = made & (trials % 7 != 0)
    rows = {
        "participant_id": "01", "group": "pd", "session": 1, "medication": "off",
        "phase": np.where(test, "test", "training"),
        "congruency": np.where(test, None, "congruent"), "item": np.where(test, None, "A"),
        "pair": np.where(test, "CB", None), "response": np.where(made, "left", None),
        "correct": np.where(made, np.where(test, 0.0, correct), np.nan),
        "rt_s": np.where(made, 0.5, np.nan),
        "reward": np.where(correct & ~test, 1.0, np.nan),
    }  # fmt: skip
    return pd.DataFrame(rows)


def selection_file():
    numbers = np.arange(200)
    rows = {"subj_idx": 0, "cond": np.where(numbers % 2, "CD", "AB"), "trial": numbers // 2 + 1.0}
    better = np.where(numbers % 3 > 0, 1.0, 0.0)
    return pd.DataFrame({**rows, "rt": 0.8, "response": better, "feedback": 1.0})


FILES = {
    behaviour_data.motion: motion_file,
    behaviour_data.learned_pairs: pairs_file,
    behaviour_data.selection: selection_file,
    behaviour_data.stop_signal: stop_file,
    behaviour_data.simon: simon_file,
}


def test_the_sets_are_made_from_a_folder_with_their_licences(tmp_path):
    for file, table_of, _ in behaviour_data.SETS.values():
        FILES[table_of]().to_csv(tmp_path / file, index=False)
    for licence in behaviour_data.LICENCES:
        (tmp_path / licence).write_text("unedited")
    behaviour_data.write_sets(tmp_path, tmp_path / "made")
    for name in behaviour_data.SETS:
        table = pd.read_parquet(tmp_path / "made" / f"{name}.parquet")
        assert table.shape[0] == 200
        assert table["participant_id"][0] in ("01", "0")
        about = read_provenance(tmp_path / "made" / f"{name}.parquet")["parameters"]
        assert list(about["columns"]) == sorted(table.columns)
        assert str(tmp_path) not in str(about)
    assert (tmp_path / "made" / behaviour_data.LICENCES[0]).read_text() == "unedited"


def test_codes_become_those_of_the_package():
    assert behaviour_data.motion(motion_file())["response"].sum() == motion_file()["choice"].sum()
    made = behaviour_data.learned_pairs(pairs_file())
    assert made["trial"].tolist() == [*range(100), *range(100)]
    assert (made["conflict"] == np.where(pairs_file()["conf"] == "HC", "high", "low")).all()
    assert behaviour_data.stop_signal(stop_file())["ssd"].notna().sum() == 50
    made = behaviour_data.simon(simon_file())
    test = made["phase"] == "test"
    # The left item of CB was chosen in every response, and B comes first in the alphabet.
    assert made.loc[test, "response"].dropna().tolist() == [0] * 45
    assert made["response"].isna().sum() == made["rt"].isna().sum() == 20
    assert set(made.loc[test, "congruency"]) == set(made.loc[test, "item"]) == {"none"}
    assert behaviour_data.selection(selection_file())["pair_trial"].tolist()[:4] == [0, 0, 1, 1]
