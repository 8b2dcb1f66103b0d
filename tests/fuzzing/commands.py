"""Commands: valid options, and what holds for their results."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import pandas as pd

from bgmodel.support.files import read_table
from circuits import anatomy
from tests.fuzzing.case import Case, Rng, pick
from tests.fuzzing.files import toml

OTHER_WORDS = {
    "ctx->STN=0.3": "without evidence",
    "0.9999": "reads no OUT below",
    "1e12": "memory",
    "1e13": "memory",
}
"""What a sentence says of a value that it does not repeat."""


def _words(broken: list[str]) -> tuple[str, ...]:
    """Return names and values of the options that are broken, as a sentence may hold them."""
    words = []
    for one in broken:
        words += [OTHER_WORDS.get(one, one), *re.split(r"[=>\[\]-]+", one)]
        words += [name.replace("-", "_") for name in one.lstrip("-").split(".")]
    return tuple(word for word in words if word)


def command(
    base: Callable[[Rng, Path], list[str]],
    breaks: list[list[str]],
    check: Callable[[Path], None] | None = None,
) -> Callable[[Rng, Path], Case]:
    """Return the generator of one command: valid options by half, else one broken one added."""

    def make(rng: Rng, folder: Path) -> Case:
        arguments, valid = base(rng, folder), bool(rng.random() < 0.5)
        broken = [] if valid else breaks[int(rng.integers(len(breaks)))]
        arguments = [str(argument) for argument in [*arguments, *broken]]
        return Case(valid, arguments, check=check and (lambda: check(folder)), words=_words(broken))

    return make


def _out(rng: Rng, folder: Path) -> Path:
    return folder / f"out{pick(rng, '.csv', '.parquet')}"


def _result(folder: Path) -> pd.DataFrame:
    (path,) = (p for p in folder.glob("out.*") if p.suffix in (".csv", ".parquet"))
    return read_table(path)


def decide(rng: Rng, folder: Path) -> list:
    """Decide on gratings."""
    criterion = pick(rng, ["--delta", rng.uniform(0, 8)], ["--posterior", rng.uniform(0.55, 0.99)])
    more = pick(rng, [], ["--no-forced"], ["--step-ms", rng.uniform(1, 900)])
    period = pick(rng, 1, 1.5, 2, 2.5, 3, 4, 5)
    if rng.random() < 0.2:
        criterion = ["--task", "orientation", "--orientations", rng.integers(2, 9)]
        criterion += ["--posterior", rng.uniform(0.55, 0.99)]
        period = 3
    given = ["--trials", rng.integers(1, 60), "--t-max", rng.integers(1, 20)]
    return ["decide", _out(rng, folder), *criterion, "--period-mm", period, *given, *more]


def check_decide(folder: Path) -> None:
    """Hold to bounds: one row per trial, times on the clock, choices that are names."""
    table = _result(folder)
    assert table["trial"].tolist() == list(range(len(table)))
    assert table["steps"].dropna().between(1, 20).all()
    assert (table["undecided"] == table["rt"].isna()).all()
    known = table[~table["undecided"]]
    assert (known["correct"] == (known["response"] == known["stimulus"])).all()


OUTPUT = [["--output-is-none"], ["--trials", "many"], ["--seed", "-1"], ["--seed", "x"]]
DRAWN = [
    ["--trials", "0"],
    ["--trials", "1e13"],
    ["--trials", "2.5"],
    ["--t-max", "0"],
    ["--step-ms", "0"],
    ["--step-ms", "nan"],
]
STIMULI = [
    *OUTPUT,
    *DRAWN,
    ["--channels", "1"],
    ["--channels", "two"],
    ["--d-prime", "0"],
    ["--d-prime", "inf"],
    ["--conflict", "1"],
    ["--task", "walk"],
    ["--period-mm", "3.5"],
    ["--evidence", "absent.csv"],
]
TABLE = [
    ["--edits.without", "thalamus"],
    ["--edits.without", "STN=2"],
    ["--edits.without", "SNr"],
    ["--edits.without", "STN=x"],
    ["--edits.scale", "STN"],
    ["--edits.scale", "STN->GPe=-1"],
    ["--edits.scale", "STN->ctx=1"],
    ["--edits.scale", "STN->GPe[9]=1"],
    ["--edits.dopamine", "3"],
    ["--edits.change", "STN.wieght=1"],
    ["--edits.change", "STM.bias_nats=1"],
    ["--edits.change", "STN->GPe.delay_ms=fast"],
    ["--edits.add", "D1->GPe"],
    ["--edits.add", "TRN like=thalamus"],
    ["--edits.neurons", "3", "--engine", "algebra"],
    ["--edits.connections", "2"],
    ["--edits.spread", "5"],
]


def learn(rng: Rng, folder: Path) -> list:
    """Learn a gap."""
    given = ["--runs", rng.integers(1, 3), "--t-max", rng.integers(2, 12)]
    given += ["--start-delta", rng.uniform(0, 8), "--xi", rng.uniform(1, 100)]
    return ["learn", _out(rng, folder), *given, "--learner.episodes", 500, "--seed", 3]


def simulate(rng: Rng, folder: Path) -> list:
    """Tap."""
    yaw = pick(rng, [], ["--yaw-deg", rng.uniform(-90, 90)])
    periods = pick(rng, [0, 5], [0], [5])
    given = ["--taps", rng.integers(1, 12), *yaw, "--seed", rng.integers(9)]
    return ["simulate", folder / "out.npz", "--periods-mm", *periods, *given]


def train(rng: Rng, folder: Path) -> list:
    """Train on the taps that lie there."""
    quick = ["--training.width", 0.1, "--training.epochs", 1, "--training.batch"]
    given = [*quick, rng.integers(4, 12), "--seed", rng.integers(9)]
    return ["train", folder.parent / "taps.npz", folder / "out.safetensors", *given]


def decode(rng: Rng, folder: Path) -> list:
    """Decode the taps that lie there."""
    files = folder.parent / "decoder.safetensors", folder.parent / "taps.npz"
    return ["decode", *files, _out(rng, folder)]


def show(rng: Rng, folder: Path) -> list:
    """Show a table."""
    name = pick(rng, *anatomy.CIRCUITS)
    drawing = ["--drawing", folder / "out.png"] if rng.random() < 0.2 else []
    return ["circuit", "show", name, "--channels", rng.integers(2, 9), *drawing, *edits(rng, name)]


def edits(rng: Rng, name: str = "spiking_msprt") -> list:
    """Return edits that leave a circuit that works."""
    return pick(
        rng,
        [],
        ["--edits.without", f"STN={rng.uniform(0, 0.05):.3f}"],
        ["--edits.scale", f"STN->GPe={rng.uniform(0.98, 1.02):.3f}"],
        ["--edits.scale", f"D1->SNr[0]={rng.uniform(0.98, 1.02):.3f}"],
        ["--edits.change", f"STN.cite={rng.integers(9)}"],
        ["--edits.add", f"STN->D1 weight={rng.uniform(0, 0.001):.4f}"],
    )


def circuit_run(rng: Rng, folder: Path) -> list:
    """Let a circuit decide."""
    engine = pick(rng, "algebra", "rate", "ensemble")
    given = ["--engine", engine, "--trials", rng.integers(1, 6), "--t-max", rng.integers(1, 6)]
    given += ["--channels", rng.integers(2, 5), "--posterior", rng.uniform(0.7, 0.88)]
    given += ["--d-prime", rng.uniform(0.2, 2)]
    given += ["--edits.neurons", 20] if engine == "ensemble" else []
    return ["circuit", "run", _out(rng, folder), *given, "--seed", rng.integers(9), *edits(rng)]


def check_run(folder: Path) -> None:
    """Hold to bounds, as decisions of a circuit have them."""
    table = _result(folder)
    assert table["trial"].tolist() == list(range(len(table)))
    assert table["rt"].between(0, 0.051 * 7).all()
    assert table["steps"].between(0, 5).all()
    assert (table["correct"] == (table["response"] == table["stimulus"])).all()


def comparing(*words: str) -> Callable[[Rng, Path], list]:
    """Compare, or lesion."""

    def base(rng: Rng, folder: Path) -> list:
        lesions = pick(rng, ["STN=0.02"], ["D1->SNr=0.99", "D2"], ["D2->GPe[0]=0.99"])
        given = ["--engine", "algebra", "--trials", 100, "--t-max", rng.integers(4, 9)]
        given += ["--d-prime", 2, "--channels", rng.integers(2, 5)]
        given += ["--accuracies", rng.uniform(0.85, 0.97)]
        lesions = lesions if "lesion" in words else []
        return [*words, _out(rng, folder), *lesions, *given, "--seed", rng.integers(9)]

    return base


def check_compared(folder: Path) -> None:
    """Hold to bounds: shares are shares, a value lies in its interval."""
    table = _result(folder).dropna(subset=["value"])
    shares = table[table["measure"].isin(["agreement", "forced", "accuracy"])]
    if "kind" in table:
        shares = shares[shares["kind"] != "change"]
    assert shares["value"].between(0, 1).all()
    known = table.dropna(subset=["low", "high"])
    assert (known["low"] <= known["high"]).all()


def circuit_learn(rng: Rng, folder: Path) -> list:
    """Let dopamine learn."""
    given = ["--trials", rng.integers(2, 20), "--t-max", rng.integers(1, 6), "--levels", 2]
    given += ["--runs", rng.integers(1, 3), "--learner.episodes", 500, "--seed", rng.integers(9)]
    # The default circuit decides too little in so few readings.
    return ["circuit", "learn", _out(rng, folder), "--circuit", "spiking_msprt", *given]


def experiment(rng: Rng, folder: Path) -> list:
    """Run an experiment from a file."""
    text = toml(rng, valid=True)
    (folder / "mine.toml").write_text(text)
    return ["experiment", folder / "mine.toml", folder / "out.csv", "--trials", 220]


def check_experiment(folder: Path) -> None:
    """Hold to counts: two rows per trial, every prediction with one outcome."""
    trials = read_table(folder / "out_trials.csv")
    measures = read_table(folder / "out.csv")
    assert len(trials) in (220, 440)
    assert (trials["rt"].isna() == trials["undecided"]).all()
    assert measures["outcome"].notna().sum() == 1


def figures(rng: Rng, folder: Path) -> list:
    """Draw figures."""
    return ["figures", *pick(rng, [], ["fig4a"], ["fig3", "figC1"], ["--fast"])]
