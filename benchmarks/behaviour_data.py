"""The built-in data sets of choices and response times, from csv files published with code.

``python -m benchmarks.behaviour_data FOLDER`` reads roitman_shadlen_2002.csv,
palmer_huk_shadlen_2005.csv, cavanagh_2011_hddm.csv, rlddm_hddm.csv, stop_signal_cnp_controls.csv,
parkinson_simon_2018.csv and the two licence texts in FOLDER. It writes parquet files with
consistent columns to ``bgmodel/data``, and copies the licences there. ``--cells FOLDER`` names the
folder of trials.parquet and spikes.parquet of striatal cells.
"""

from __future__ import annotations

import argparse
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from bgmodel.support.files import checksum, write_table

LAST_SPIKE_S = 1.1
"""Spikes after the longest clicks and the delay of the cells are not shipped, s."""
DATA = Path(__file__).parents[1] / "bgmodel" / "data"
LICENCES = ("LICENSE.CoSMo2017.txt", "LICENSE.HDDM.txt")
NOTE = "No repository states a licence for the data apart from its code."
EVERYWHERE = {
    "participant_id": "who decided",
    "trial": "number of the trial of this participant, from 0",
    "rt": "time from the onset of the stimulus to the response, s; NaN without a response",
}
MOTION: dict[str, Any] = {
    "columns": {
        **EVERYWHERE,
        "response": "1 or 0: one direction of motion or the other; empty without a response",
        "coherence": "fraction of dots that move together; positive speaks for response 1",
        "correct": "1 or 0; empty where the coherence is 0",
    },
    "strength": "coherence",
    "conditions": [],
    "licence": "BSD-3-Clause",
    "licence_file": LICENCES[0],
    "note": NOTE,
}
ROITMAN = {
    **MOTION,
    "citation": "Roitman, J. D. & Shadlen, M. N. (2002). Response of neurons in the lateral "
    "intraparietal area during a combined visual discrimination reaction time task. Journal of "
    "Neuroscience 22, 9475-9489.",
    "source": "https://github.com/DrugowitschLab/CoSMo2017, rs_b.mat and rs_n.mat",
}
PALMER = {
    **MOTION,
    "citation": "Palmer, J., Huk, A. C. & Shadlen, M. N. (2005). The effect of stimulus strength "
    "on the speed and accuracy of a perceptual decision. Journal of Vision 5(5):1, 376-404.",
    "source": "https://github.com/DrugowitschLab/CoSMo2017, phs_*.mat",
}
CAVANAGH = {
    "columns": {
        **EVERYWHERE,
        "response": "1: the item that was rewarded more often; 0: the other; empty without one",
        "conflict": "high: both items good or both bad; low: one of each",
        "pair": "WW: both items good; LL: both bad; WL: one of each",
        "stimulation": "on or off: deep brain stimulation of the subthalamic nucleus",
        "theta": "power of mediofrontal theta in this trial, z-scored",
    },
    "strength": None,
    "conditions": ["conflict", "stimulation"],
    "licence": "BSD-2-Clause",
    "licence_file": LICENCES[1],
    "note": NOTE,
    "citation": "Cavanagh, J. F., Wiecki, T. V., Cohen, M. X., Figueroa, C. M., Samanta, J., "
    "Sherman, S. J. & Frank, M. J. (2011). Subthalamic nucleus stimulation reverses mediofrontal "
    "influence over decision threshold. Nature Neuroscience 14, 1462-1467.",
    "source": "https://github.com/hddm-devs/hddm, hddm/examples/cavanagh_theta_nn.csv",
}
SELECTION = {
    **CAVANAGH,
    "columns": {
        **EVERYWHERE,
        "response": "1: the item of the pair that is rewarded more often; 0: the other",
        "pair": "AB, CD or EF: rewarded with probabilities of 0.8 and 0.2, 0.7 and 0.3, 0.6 and "
        "0.4",
        "pair_trial": "number of the presentation of this pair, from 0; 60 of them are missing",
        "reward": "1 or 0: feedback on the chosen item",
    },
    "conditions": ["pair"],
    "citation": "Pedersen, M. L. & Frank, M. J. (2020). Simultaneous hierarchical Bayesian "
    "parameter estimation for reinforcement learning and drift diffusion models: a tutorial and "
    "links to neural data. Computational Brain & Behavior 3, 458-471.",
    "source": "https://github.com/hddm-devs/hddm, hddm/examples/rlddm_data.csv",
}

STOP: dict[str, Any] = {
    "columns": {
        "participant_id": EVERYWHERE["participant_id"],
        "trial": EVERYWHERE["trial"],
        "rt": "time from the arrow to the response, s; NaN without a response",
        "ssd": "stop-signal delay: time from the arrow to the stop signal, s; NaN in go trials",
        "stimulus": "direction of the arrow, left or right",
        "response": "the key that was pressed, left or right; empty without a response",
    },
    "licence": "CC0-1.0",
    "citation": "Poldrack, R. A. et al. (2016). A phenome-wide examination of neural and cognitive "
    "function. Scientific Data 3, 160110.",
    "source": "https://openneuro.org/datasets/ds000030, version 1.0.0, healthy controls, task "
    "stopsignal",
    "note": "126 healthy adults, 128 trials each, a quarter of them stop trials, two staircases.",
}

SIMON: dict[str, Any] = {
    "columns": {
        **EVERYWHERE,
        "response": "training: 1 correct, 0 error; test: 1 the first of the two items in the "
        "alphabet, which was rewarded at least as often, 0 the other; empty without a response",
        "group": "pd: Parkinson's disease; ctl: control",
        "session": "1 or 2; controls have one session",
        "medication": "on or off: dopaminergic medication; none: control",
        "phase": "training: press the side that the colour asks for; test: choose one of two items",
        "congruency": "congruent: the item is shown on the side that its colour asks for; "
        "incongruent: on the other side; none: test",
        "item": "item shown in training, A to D; none in the test. Correct responses to A are "
        "always rewarded, to D never, to B if congruent, to C if incongruent",
        "pair": "items of a test trial, the left one first; none in training",
        "side": "side of the response, left or right; empty without a response",
        "reward": "1 or 0 after a correct response in training, otherwise empty",
    },
    "strength": None,
    "conditions": ["medication", "congruency"],
    "licence": "CC0-1.0",
    "licence_file": "",
    "citation": "Singh, A., Richardson, S. P., Narayanan, N. & Cavanagh, J. F. (2018). Mid-frontal "
    "theta activity is diminished during cognitive control in Parkinson's disease. "
    "Neuropsychologia 117, 113-122; Cavanagh, J. F., Mueller, A. A., Brown, D. R., Janowich, J. "
    "R., Story-Remer, J. H., Wegele, A. & Richardson, S. P. (2017). Cognitive states influence "
    "dopamine-driven aberrant learning in Parkinson's disease. Cortex 90, 115-124.",
    "source": "https://openneuro.org/datasets/ds003509, version 1.1.0",
    "note": "Simon task with reward learning: 28 patients, once on and once off medication, and 28 "
    "controls.",
}

CELLS: dict[str, Any] = {
    "strength": None,
    "conditions": [],
    "licence": "Apache-2.0",
    "licence_file": "LICENSE.DePasquale2024.txt",
    "citation": "DePasquale, B., Brody, C. D. & Pillow, J. W. (2024). Neural population dynamics "
    "underlying evidence accumulation in multiple rat brain regions. eLife 13, RP84955.",
    "source": "https://github.com/Brody-Lab/DePasquale-eLife-2023, data/by_session, rat T103",
    "note": "Anterior dorsal striatum, 20 sessions, 48 cells; times are rounded to 0.1 ms.",
    "columns": {
        "participant_id": EVERYWHERE["participant_id"],
        "session": "number of the session",
        "trial": "number of the trial of this session",
        "rt": "duration of the clicks, s: the choice is asked for at their end",
        "response": "left or right: the side that was chosen",
        "left_s": "times of the clicks on the left from the first one on, s, a list",
        "right_s": "the same on the right",
        "cell": "number of the cell",
        "time_s": "time of a spike from the onset of the clicks, -0.5 to 1.1 s",
    },
}


def motion(raw: pd.DataFrame) -> pd.DataFrame:
    """Return one row per trial of a motion task; ValueError if the signs are not as documented.

    Columns participant_id, trial, rt (s), choice (0 or 1), signed_coherence, correct (NaN at 0).
    """
    # The files contain a -0, which is the same strength as 0.
    coherence = raw["signed_coherence"].astype("float64") + 0.0
    correct = raw["correct"].astype("Int8")
    known = correct.notna()
    if (coherence[known] == 0).any() or (coherence[~known] != 0).any():
        raise ValueError("correct must be empty at a coherence of 0 and nowhere else")
    if not ((raw["choice"] == (coherence > 0)) == (correct == 1))[known].all():
        raise ValueError("a correct choice must be 1 if the coherence is positive, otherwise 0")
    shares = raw["choice"].groupby(coherence).mean()
    # For the strongest coherences the share saturates at 0 or 1, so steps may be 0.
    if not (np.diff(shares) >= 0).all() or shares.iloc[0] == shares.iloc[-1]:
        raise ValueError("choices of 1 must become more frequent with the signed coherence")
    return pd.DataFrame(
        {
            "participant_id": raw["participant_id"].astype(str),
            "trial": raw["trial"].astype("int64"),
            "rt": raw["rt"].astype("float64"),
            "response": raw["choice"].astype("Int8"),
            "coherence": coherence,
            "correct": correct,
        }
    )


def learned_pairs(raw: pd.DataFrame) -> pd.DataFrame:
    """Return one row per trial of choices between learned items; ValueError if codes disagree.

    Columns subj_idx, stim (WW, LL, WL), rt (s), response (0 or 1), theta, dbs (0 or 1), conf (HC or
    LC).
    """
    high = raw["conf"].map({"HC": True, "LC": False}).astype(bool)
    if not (high == raw["stim"].isin(["WW", "LL"])).all():
        raise ValueError("conf must be HC where stim is WW or LL, and LC where it is WL")
    if not raw["response"][~high].mean() > raw["response"][high].mean() > 0.5:
        raise ValueError("response must be 1 for the better item: most often without conflict")
    return pd.DataFrame(
        {
            "participant_id": raw["subj_idx"].astype(str),
            "trial": raw.groupby("subj_idx").cumcount().astype("int64"),
            "rt": raw["rt"].astype("float64"),
            "response": raw["response"].astype("Int8"),
            "conflict": np.where(high, "high", "low"),
            "pair": raw["stim"].astype(str),
            "stimulation": raw["dbs"].map({1: "on", 0: "off"}).astype(str),
            "theta": raw["theta"].astype("float64"),
        }
    )


def selection(raw: pd.DataFrame) -> pd.DataFrame:
    """Return one row per trial of probabilistic selection; ValueError if columns disagree.

    Columns subj_idx, response (0 or 1), cond (AB, CD, EF), rt (s), trial (of the pair, from 1, with
    gaps) and feedback (0 or 1), in the order of presentation.
    """
    if not (raw.groupby(["subj_idx", "cond"])["trial"].diff().dropna() > 0).all():
        raise ValueError("trial must number the trials of each pair in their order")
    return pd.DataFrame(
        {
            "participant_id": raw["subj_idx"].astype(str),
            "trial": raw.groupby("subj_idx").cumcount().astype("int64"),
            "rt": raw["rt"].astype("float64"),
            "response": raw["response"].astype("Int8"),
            "pair": raw["cond"].astype(str),
            "pair_trial": raw["trial"].astype("int64") - 1,
            "reward": raw["feedback"].astype("int64"),
        }
    )


def stop_signal(raw: pd.DataFrame) -> pd.DataFrame:
    """Return one row per trial of a stop-signal task; ValueError if columns disagree.

    Columns participant_id, trial (from 1), trial_type (go, stop), stimulus, response, rt_s and
    ssd_s (s).
    """
    stop = raw["trial_type"].map({"go": False, "stop": True}).astype(bool)
    if not (stop == raw["ssd_s"].notna()).all():
        raise ValueError("ssd_s must be given in stop trials and nowhere else")
    if not (raw["response"].notna() == raw["rt_s"].notna()).all():
        raise ValueError("response and rt_s must be given in the same trials")
    return pd.DataFrame(
        {
            "participant_id": raw["participant_id"].astype(str),
            "trial": raw["trial"].astype("int64") - 1,
            "rt": raw["rt_s"].astype("float64"),
            "ssd": raw["ssd_s"].astype("float64"),
            "stimulus": raw["stimulus"].astype(str),
            "response": raw["response"].astype("string"),
        }
    )


def simon(raw: pd.DataFrame) -> pd.DataFrame:
    """Return one row per trial of a Simon task and of the test after it; ValueError if they differ.

    Columns participant_id, group (ctl, pd), session, medication (on, off, none), phase (training,
    test), congruency, item, pair, response (left, right), correct (0, 1), rt_s (s) and reward (0,
    1). In a pair the left item comes first; correct is 1 where the item that comes first in the
    alphabet is chosen.
    """
    if not (raw["response"].notna() == raw["rt_s"].notna()).all():
        raise ValueError("response and rt_s must be given in the same trials")
    if not ((raw["group"] == "ctl") == (raw["medication"] == "none")).all():
        raise ValueError("medication must be none in controls and nowhere else")
    if (raw["reward"].notna() & (raw["correct"] != 1)).any():
        raise ValueError("reward must be empty where the response is not correct")
    test = raw["phase"] == "test"
    if not (test == raw["pair"].notna()).all():
        raise ValueError("pair must be given in the test and nowhere else")
    first = (raw["pair"].str[0] < raw["pair"].str[1]) == (raw["response"] == "left")
    correct = raw["correct"].mask(test, first.astype("float64")).where(raw["response"].notna())
    return pd.DataFrame(
        {
            "participant_id": raw["participant_id"].astype(str),
            "trial": raw.groupby("participant_id").cumcount().astype("int64"),
            "rt": raw["rt_s"].astype("float64"),
            "response": correct.astype("Int8"),
            "group": raw["group"].astype(str),
            "session": raw["session"].astype("int8"),
            **{name: raw[name].astype(str) for name in ("medication", "phase")},
            **{
                name: raw[name].fillna("none").astype(str)
                for name in ("congruency", "item", "pair")
            },
            "side": raw["response"].astype("string"),
            "reward": raw["reward"].astype("Int8"),
        }
    )


SETS = {
    "roitman_shadlen_2002": ("roitman_shadlen_2002.csv", motion, ROITMAN),
    "palmer_huk_shadlen_2005": ("palmer_huk_shadlen_2005.csv", motion, PALMER),
    "cavanagh_2011": ("cavanagh_2011_hddm.csv", learned_pairs, CAVANAGH),
    "pedersen_frank_2020": ("rlddm_hddm.csv", selection, SELECTION),
    "stop_signal_cnp": ("stop_signal_cnp_controls.csv", stop_signal, STOP),
    "parkinson_simon_2018": ("parkinson_simon_2018.csv", simon, SIMON),
}


def write_cells(folder: Path, to: Path = DATA) -> None:
    """Write trials and spikes of striatal cells from trials.parquet and spikes.parquet."""
    trials, spikes = (pd.read_parquet(folder / f"{x}.parquet") for x in ("trials", "spikes"))
    side = trials["chose_right"].map({1: "right", 0: "left"})
    trials = trials.assign(response=side, rt=trials["stimulus_s"].round(4))
    trials = trials.rename(columns={"rat": "participant_id"})
    for name in ("left_s", "right_s"):
        trials[name] = [np.round(each, 4).astype("float32") for each in trials[name]]
    spikes = spikes[spikes["time_s"] < LAST_SPIKE_S].sort_values(["cell", "trial", "time_s"])
    spikes["time_s"] = spikes["time_s"].astype("float64").round(4).astype("float32")
    for part, table, end in (("trials", trials, ""), ("spikes", spikes, "_spikes")):
        made = {"file": f"{part}.parquet", "sha256": checksum(folder / f"{part}.parquet")}
        table = table[[name for name in CELLS["columns"] if name in table]]
        about = CELLS | {"columns": {str(x): CELLS["columns"][x] for x in table}}
        write_table(table, to / f"striatum_clicks{end}.parquet", **about, made_from=made)


def write_sets(folder: Path, to: Path = DATA) -> None:
    """Write every data set with its metadata, and the licences in the same folder."""
    for name, (file, table_of, about) in SETS.items():
        raw = pd.read_csv(folder / file, dtype={"participant_id": str})
        made = {"file": file, "sha256": checksum(folder / file)}
        write_table(table_of(raw), to / f"{name}.parquet", **about, made_from=made)
    for licence in LICENCES:
        shutil.copyfile(folder / licence, to / licence)


def main() -> None:
    """Write the data sets from the given folder."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path, help="where the published files lie")
    parser.add_argument("--to", type=Path, default=DATA, help="where the sets go")
    parser.add_argument("--cells", type=Path, help="where trials and spikes of cells lie")
    asked_for = parser.parse_args()
    write_sets(asked_for.folder, asked_for.to)
    if asked_for.cells is not None:
        write_cells(asked_for.cells, asked_for.to)


if __name__ == "__main__":
    main()
