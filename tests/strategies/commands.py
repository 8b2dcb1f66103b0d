"""Command lines that are right, options that make one wrong, and what holds for results."""

import shlex

from bgmodel.support.files import read_table
from tests.strategies.edits import NO_EVIDENCE, OPTIONS, WRONG_OPTIONS

OUT = "--save here/«out.csv|out.parquet»"
SEED = "--seed 0..8"
COMPARED = f"--engine algebra --task trials=100 d_prime=2 t_max=4..8 channels=2..4 {SEED}"
DRAWN = """--outputs-none, --task trials=many, --seed -1, --seed x, --task trials=0,
    --task trials=1e13,
    --task trials=2.5, --task t_max=0"""
STIMULI = f"""{DRAWN}, --task step_ms=0, --task step_ms=nan, --task channels=1, --task channels=two,
    --task d_prime=0,
    --task d_prime=inf, --task conflict=1, --task walk, --task period_mm=3.5, --task absent.csv"""
CIRCUIT = f"""{STIMULI}, {WRONG_OPTIONS}, --edits 'heterogeneity 5',
    --engine algebra --edits 'neurons 3'"""

COMMANDS = {
    f"decide {OUT} --task trials=1..59 t_max=1..19 «|--no-forced|--task step_ms=1.0..900» "
    "«--boundary-separation 0.01..8 --task period_mm=«1|1.5|2|2.5|3|4|5»|--posterior 0.55..0.99|"
    "--posterior 0.55..0.99 "
    "--task orientation channels=2..8 period_mm=3»": f"""{DRAWN}, --task period_mm=3.5,
        --task fold=6, --prior 0.4 0.5, --task x, --boundary-separation -1, --no-such,
        --task absent.csv""",
    f"learn {OUT} --runs 1..2 --task t_max=2..11 --start 0.01..8 --xi 1.0..100 --seed 3 "
    "--learner episodes=500": """--runs 0, --runs 1000000000000, --xi 0, --xi nan, --task fold=9,
        --start 9, --task t_max=0, --what x, --seed -1, --task period_mm=1.7, --learner episodes=3,
        --learner rate=0, --task orientation channels=3""",
    f"learn {OUT} --what weights --runs 1..2 --task t_max=3..11 --posterior 0.6..0.95 "
    "--seed 3 --learner trials=20..80 «|--rule chosen|--rule opal»": """--runs 0,
        --runs 1000000000000, --rule x, --posterior 0.4, --posterior 1, --task fold=9,
        --seed -1, --task period_mm=1.7, --learner trials=0, --learner rate=0, --feedback valid=2,
        --feedback given=0, --feedback right=3, --task channels=3""",
    "touch simulate --save here/out.npz --taps 1..11 --periods-mm «0 5|0|5» «|--yaw-deg -90.0..90» "
    f"{SEED}": """--taps 0, --taps 1000000000000, --taps a, --seed -1, --workers 0, --periods-mm -1,
        --tip layout=star, --tip pitch_mm=0, --yaw-deg x, --periods-mm 0.013""",
    "touch train taps.npz --save here/out«.safetensors|.onnx» --training width=0.1 epochs=1 "
    f"--training batch=4..11 {SEED}": """--training epochs=0, --training batch=4000,
        --training width=0, --edge, --seed x, --training validation=1, --training dropout=9,
        --training learning_rate=nan, --training network=forest, --device abacus""",
    f"touch decode decoder.safetensors taps.npz {OUT}": """--edge, --mm-per-px x,
        --no-such, more.csv""",
    "circuit show «bogacz_gurney|appendix_b|linear_gpe|macaque|spiking_msprt|gpr|humphries|"
    f"stewart» --channels 2..8 «||--plot here/out.png» «{OPTIONS}»": f"""{WRONG_OPTIONS},
        --channels 0, --channels 2000, --noise 0.1, --plot x.doc, more, --rest 3""",
    f"circuit run {OUT} --task trials=1..5 "
    f"--task t_max=1..5 channels=2..4 --posterior 0.7..0.88 --task d_prime=0.2..2 {SEED} "
    f"--engine «ensemble --edits 'neurons 20'|«algebra|rate» «{OPTIONS}»»": f"""{CIRCUIT},
        --gain 0, --gain nan, --posterior 0.2, --posterior 1,
        --posterior 0.9999, --workers 0, --engine pen, --circuit cortex, --save-rates r.txt,
        --engine ensemble --edits 'neurons 1e9'""",
    f"learn {OUT} --what dopamine --circuit spiking_msprt --levels 2 --learner episodes=500 "
    f"--task trials=20..40 t_max=30..40 --runs 1..2 {SEED}": f"""{WRONG_OPTIONS}, {NO_EVIDENCE},
        --xi 0, --levels 1, --levels 1000000000000, --runs 0, --posterior 0.3, --posterior 1,
        --gain 0,
        --start 3, --task trials=0, --task fold=8, --learner episodes=2, --engine algebra""",
    f"compare {OUT} {COMPARED} --accuracies 0.85..0.97": f"""{CIRCUIT}, {NO_EVIDENCE},
        --accuracies 0, --accuracies x, --task trials=99, --gain inf""",
    "experiment small.toml --trials 220 --save here/out.csv": """--trials 99, --trials x, --seed -1,
        --workers 0, --trials 1e13, more, --no-such""",
    "figures «|fig4a|fig3 figC3|--fast»": """fig99, --workers 0, --workers x, --recordings absent,
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
