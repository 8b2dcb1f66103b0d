"""Command lines that are right, options that make one wrong, and what holds for results."""

import shlex

from bgmodel.support.files import read_table
from tests.strategies.edits import LESIONS, NO_EVIDENCE, OPTIONS, WRONG_OPTIONS

OUT = "here/«out.csv|out.parquet»"
SEED = "--seed 0..8"
COMPARED = f"--engine algebra --trials 100 --d-prime 2 --t-max 4..8 --channels 2..4 {SEED}"
DRAWN = """--output-is-none, --trials many, --seed -1, --seed x, --trials 0, --trials 1e13,
    --trials 2.5, --t-max 0"""
STIMULI = f"""{DRAWN}, --step-ms 0, --step-ms nan, --channels 1, --channels two, --d-prime 0,
    --d-prime inf, --conflict 1, --task walk, --period-mm 3.5, --evidence absent.csv"""
CIRCUIT = f"""{STIMULI}, {WRONG_OPTIONS}, --edits 'heterogeneity 5',
    --engine algebra --edits 'neurons 3'"""

COMMANDS = {
    f"decide {OUT} --trials 1..59 --t-max 1..19 «|--no-forced|--step-ms 1.0..900» "
    "«--delta 0.01..8 --period-mm «1|1.5|2|2.5|3|4|5»|--posterior 0.55..0.99|"
    "--posterior 0.55..0.99 "
    "--task orientation --channels 2..8 --period-mm 3»": f"""{DRAWN}, --period-mm 3.5,
        --fold 6, --prior 0.4 0.5, --task x, --delta -1, --no-such, --evidence absent.csv""",
    f"learn {OUT} --runs 1..2 --t-max 2..11 --start 0.01..8 --xi 1.0..100 --seed 3 "
    "--learner.episodes 500": """--runs 0, --runs 1e12, --xi 0, --xi nan, --fold 9,
        --start 9, --t-max 0, --what x, --seed -1, --period-mm 1.7, --learner.episodes 3,
        --learner.rate 0, --task orientation --channels 3""",
    f"learn {OUT} --what weights --runs 1..2 --t-max 3..11 --units 2..16 --posterior 0.6..0.95 "
    "--seed 3 --weights.trials 20..80 «|--rule chosen|--rule opal|--critic settled»": """--runs 0,
        --runs 1e12, --units 1, --rule x, --critic x, --posterior 0.4, --posterior 1, --fold 9,
        --seed -1, --period-mm 1.7, --weights.trials 0, --weights.rate 0, --feedback.valid 2,
        --feedback.given 0, --feedback.right 3, --channels 3""",
    "simulate here/out.npz --taps 1..11 --periods-mm «0 5|0|5» «|--yaw-deg -90.0..90» "
    f"{SEED}": """--taps 0, --taps 1e12, --taps a, --seed -1, --workers 0, --periods-mm -1,
        --tip.layout star, --tip.pitch-mm 0, --yaw-deg x, --periods-mm 0.013""",
    "train taps.npz here/out«.safetensors|.onnx» --training.width 0.1 --training.epochs 1 "
    f"--training.batch 4..11 {SEED}": """--training.epochs 0, --training.batch 4000,
        --training.width 0, --edge, --seed x, --training.validation 1, --training.dropout 9,
        --training.learning-rate nan, --training.network forest, --device abacus""",
    f"decode decoder.safetensors taps.npz {OUT}": """--edge, --mm-per-px x,
        --no-such, more.csv""",
    "circuit show «bogacz_gurney|appendix_b|linear_gpe|macaque|spiking_msprt|gpr|humphries|"
    f"stewart» --channels 2..8 «||--drawing here/out.png» «{OPTIONS}»": f"""{WRONG_OPTIONS},
        --channels 0, --channels 2000, --noise 0.1, --drawing x.doc, more, --rest 3""",
    f"circuit run {OUT} --trials 1..5 "
    f"--t-max 1..5 --channels 2..4 --posterior 0.7..0.88 --d-prime 0.2..2 {SEED} "
    f"--engine «ensemble --edits 'neurons 20'|«algebra|rate» «{OPTIONS}»»": f"""{CIRCUIT},
        --gain 0, --gain nan, --posterior 0.2, --posterior 1,
        --posterior 0.9999, --workers 0, --engine pen, --circuit cortex, --rates r.txt,
        --engine ensemble --edits 'neurons 1e9'""",
    f"circuit compare-edits {OUT} «{LESIONS}» {COMPARED} --accuracies 0.85..0.97": f"""{CIRCUIT},
        {NO_EVIDENCE}, --accuracies 1, --accuracies 0.2, --trials 99, --gain -1, --workers 0""",
    f"learn {OUT} --what dopamine --circuit spiking_msprt --levels 2 --learner.episodes 500 "
    f"--trials 20..40 --t-max 30..40 --runs 1..2 {SEED}": f"""{WRONG_OPTIONS}, {NO_EVIDENCE},
        --xi 0, --levels 1, --levels 1e12, --runs 0, --posterior 0.3, --posterior 1, --gain 0,
        --start 3, --trials 0, --fold 8, --learner.episodes 2, --engine algebra""",
    f"compare {OUT} {COMPARED} --accuracies 0.85..0.97": f"""{CIRCUIT}, {NO_EVIDENCE},
        --accuracies 0, --accuracies x, --trials 99, --gain inf""",
    "experiment small.toml here/out.csv --trials 220": """--trials 99, --trials x, --seed -1,
        --workers 0, --trials 1e13, more, --no-such""",
    "figures «|fig4a|fig3 figC1|--fast»": """fig99, --cores 0, --cores x, --recordings absent,
        figR1, fig4, --no-such""",
}
"""Lines of every command, with options that make each of them wrong."""


def options(text):
    """Return the options of a text, each a list of words."""
    return [shlex.split(one) for one in text.split(",")]


def check_result(folder):
    """Hold a table that a command wrote to bounds; each command writes some of these columns."""
    for path in [path for path in folder.iterdir() if path.suffix in (".csv", ".parquet")]:
        table = read_table(path)
        if "response" in table:
            assert (table["undecided"] == table["rt"].isna()).all()
            known = table[~table["undecided"]]
            assert (known["correct"] == (known["response"] == known["stimulus"])).all()
        if "low" in table and "outcome" not in table:
            known = table.dropna(subset=["value", "low", "high"])
            assert (known["low"] <= known["high"]).all()
            shares = table[table["measure"].isin(["agreement", "forced", "accuracy"])]
            shares = shares[shares["kind"] != "change"] if "kind" in table else shares
            assert shares["value"].dropna().between(0, 1).all()
