"""Every kind of input, with the options that break it."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from bgmodel.cli import main
from tests.fuzzing.case import Case, Rng
from tests.fuzzing.circuit_edits import circuit_edit
from tests.fuzzing.commands import (
    DRAWN,
    OUTPUT,
    STIMULI,
    TABLE,
    check_compared,
    check_decide,
    check_experiment,
    check_run,
    circuit_learn,
    circuit_run,
    command,
    comparing,
    decide,
    decode,
    experiment,
    figures,
    learn,
    show,
    simulate,
    train,
)
from tests.fuzzing.files import toml_file
from tests.fuzzing.tables import in_memory, table_file

KINDS: dict[str, tuple[int, Callable[[Rng, Path], Case]]] = {
    "table in memory": (2000, in_memory),
    "table .csv, decide": (700, table_file("decide", ".csv")),
    "table .parquet, decide": (500, table_file("decide", ".parquet")),
    "table .csv, circuit run": (500, table_file("circuit run", ".csv")),
    "table .parquet, circuit run": (300, table_file("circuit run", ".parquet")),
    "experiment's file": (1400, toml_file),
    "circuit, edited": (2200, circuit_edit),
    "decide": (
        200,
        command(
            decide,
            [*OUTPUT, *DRAWN[:4], ["--period-mm", "3.5"], ["--fold", "6"], ["--prior", ".4", ".5"],
             ["--task", "x"], ["--evidence", "absent.csv"], ["--delta", "-1"], ["--no-such"]],
            check_decide,
        ),
    ),
    "learn": (
        200,
        command(
            learn,
            [["--runs", "0"], ["--runs", "1e12"], ["--xi", "0"], ["--xi", "nan"], ["--fold", "9"],
             ["--start-delta", "9"], ["--t-max", "0"], ["--policy", "x"], ["--seed", "-1"],
             ["--period-mm", "1.7"], ["--learner.episodes", "3"], ["--learner.rate", "0"]],
        ),
    ),
    "simulate": (
        200,
        command(
            simulate,
            [["--taps", "0"], ["--taps", "1e12"], ["--taps", "a"], ["--seed", "-1"],
             ["--workers", "0"], ["--periods-mm", "-1"], ["--tip.layout", "star"],
             ["--tip.pitch-mm", "0"], ["--yaw-deg", "x"], ["--periods-mm", "0.013"]],
        ),
    ),
    "train": (
        200,
        command(
            train,
            [["--training.epochs", "0"], ["--training.batch", "4000"], ["--training.width", "0"],
             ["--training.validation", "1"], ["--edge"], ["--seed", "x"],
             ["--training.dropout", "9"],
             ["--training.learning-rate", "nan"], ["--training.network", "forest"]],
        ),
    ),
    "decode": (
        200,
        command(decode, [["--edge"], ["--mm-per-px", "x"], ["--no-such"], ["more.csv"]]),
    ),
    "circuit show": (
        200,
        command(
            show,
            [*TABLE[:15], ["--channels", "0"], ["--channels", "2000"], ["--noise", "0.1"],
             ["--drawing", "x.doc"], ["more"], ["--rest", "3"]],
        ),
    ),
    "circuit run": (
        300,
        command(
            circuit_run,
            [*STIMULI, *TABLE, ["--gain", "0"], ["--gain", "nan"], ["--posterior", "0.2"],
             ["--posterior", "1"], ["--posterior", "0.9999"], ["--workers", "0"],
             ["--engine", "pen"], ["--circuit", "cortex"], ["--rates", "r.txt"],
             ["--engine", "ensemble", "--edits.neurons", "1e9"]],
            check_run,
        ),
    ),
    "circuit lesion": (
        200,
        command(
            comparing("circuit", "lesion"),
            [*STIMULI, *TABLE, ["--accuracies", "1"], ["--accuracies", "0.2"], ["--trials", "99"],
             ["--gain", "-1"], ["--workers", "0"], ["--edits.scale", "ctx->STN=0.3"]],
            check_compared,
        ),
    ),
    "circuit learn": (
        200,
        command(
            circuit_learn,
            [["--xi", "0"], ["--levels", "1"], ["--levels", "1e12"], ["--runs", "0"],
             ["--posterior", "0.3"], ["--posterior", "1"], ["--gain", "0"], ["--start-level", "3"],
             ["--trials", "0"], ["--fold", "8"], *TABLE[:6], ["--edits.scale", "ctx->STN=0.3"],
             ["--learner.episodes", "2"], ["--engine", "algebra"]],
        ),
    ),
    "compare": (
        200,
        command(
            comparing("compare"),
            [*STIMULI, *TABLE, ["--accuracies", "0"], ["--accuracies", "x"], ["--trials", "99"],
             ["--gain", "inf"], ["--edits.scale", "ctx->STN=0.3"]],
            check_compared,
        ),
    ),
    "experiment": (
        200,
        command(
            experiment,
            [["--trials", "99"], ["--trials", "x"], ["--seed", "-1"], ["--workers", "0"],
             ["--trials", "1e13"], ["more"], ["--no-such"]],
            check_experiment,
        ),
    ),
    "figures": (
        200,
        command(
            figures,
            [["fig99"], ["--cores", "0"], ["--cores", "x"], ["--recordings", "absent"], ["figR1"],
             ["fig4"], ["--no-such"]],
        ),
    ),
}  # fmt: skip
"""Each kind of input with how many of it are tried."""


def prepare(folder: Path) -> None:
    """Write the taps and the decoder that `train` and `decode` are given."""
    taps, decoder = folder / "taps.npz", folder / "decoder.safetensors"
    quick = ["--training.width", "0.1", "--training.epochs", "1", "--training.batch", "8"]
    assert main(["simulate", str(taps), "--taps", "30", "--periods-mm", "0", "5"]) == 0
    assert main(["train", str(taps), str(decoder), *quick]) == 0
