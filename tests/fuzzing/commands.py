"""Random inputs, valid and broken, as a new user would type, edit and write them.

Each kind of input has a generator: ``make(rng, folder)`` returns a ``Case``. A broken one is a
valid one with exactly one thing made wrong, so that it is known whether it must be refused.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from scipy.special import log_softmax, logsumexp

from bgmodel import first_crossing
from bgmodel.experiments.experiment import read_experiment
from bgmodel.files import read_table
from bgmodel.integrators.sprt import Msprt
from bgmodel.tables.evidence import trials_from_table
from bgmodel.tables.trials import trial_table
from circuits import anatomy
from circuits.cells import Phase, Rate
from circuits.engines import run
from circuits.rows import Population, Projection

Rng = np.random.Generator


@dataclass
class Case:
    """One input.

    Parameters
    ----------
    valid : bool
        Whether it must give a result, or one sentence.
    arguments : list of str, optional
        Of a command, if it is one.
    call : callable, optional
        Else what to call; a broken one must raise ValueError.
    check : callable, optional
        Holds the result of a valid one to an oracle: gets what ``call`` returned, or nothing.
    words : tuple of str
        The sentence on a broken one must hold one of these: it is refused for what is broken.
    """

    valid: bool
    arguments: list[str] | None = None
    call: Callable[[], Any] | None = None
    check: Callable[..., None] | None = None
    words: tuple[str, ...] = ()


def pick(rng: Rng, *values: Any) -> Any:
    """Return one of the values."""
    return values[int(rng.integers(len(values)))]


# ---- evidence tables

NAMES = ("left", "right", "up", "a b", "1", "S1", "näher", "x.y")
IDS = {
    "numbers": lambda n, rng: rng.permutation(10 * n)[:n],
    "text": lambda n, rng: np.array([f"s{k:04d}" for k in rng.permutation(n)], dtype=object),
    "zeros before": lambda n, rng: np.array([f"{k:05d}" for k in range(n)], dtype=object),
    "dotted": lambda n, rng: rng.permutation(n) + 0.5,
}
EXTRA = {
    "block": lambda n, rng: rng.integers(0, 3, n),
    "rt": lambda n, rng: rng.gamma(2, 0.3, n).round(3),
    "condition": lambda n, rng: rng.choice(["easy", "hard"], n),
    "response": lambda n, rng: rng.choice(["NA", "x", ""], n),
    "model": lambda n, rng: rng.choice(["m1", "m2"], n),
}


def evidence_table(rng: Rng) -> pd.DataFrame:
    """Return a valid table: unequal trials, ids and columns of any kind."""
    trials, most = int(rng.integers(1, 25)), int(rng.integers(1, 15))
    names = rng.permutation(NAMES)[: int(rng.integers(2, 6))]
    lengths = rng.integers(1, most + 1, trials) if rng.random() < 0.7 else np.full(trials, most)
    of = np.repeat(np.arange(trials), lengths)
    scale = pick(rng, 0.0, 0.3, 1.0, 4.0)
    table = pd.DataFrame({"trial": IDS[pick(rng, *IDS)](trials, rng)[of]})
    table["step"] = np.concatenate([np.arange(n) for n in lengths]) + int(rng.integers(2))
    for name in names:
        table[f"ll_{name}"] = rng.normal(0, scale, len(of)) if scale else 0.0
    if rng.random() < 0.6:
        table["truth"] = rng.choice(names, trials)[of]
    if rng.random() < 0.3:
        table["participant_id"] = np.array(["p1", "p2"])[np.arange(trials) % 2][of]
    for name in rng.permutation(list(EXTRA))[: int(rng.integers(4))]:
        table[name] = EXTRA[name](trials, rng)[of]
    if rng.random() < 0.2:
        table["eye_x"] = rng.normal(0, 1, len(of))
    if rng.random() < 0.5:
        # The rows in any order; trials keep the order in which each is first named.
        table = table.sample(frac=1, random_state=int(rng.integers(2**31)))
    order = rng.permutation(table.columns)
    return table[order].reset_index(drop=True)


def _first_ll(table: pd.DataFrame) -> str:
    return next(name for name in table if name.startswith("ll_"))


def _with(table: pd.DataFrame, name: str, row: int, value: Any) -> pd.DataFrame:
    column = table[name].astype(object).copy()
    column.iloc[row] = value
    return table.assign(**{name: column})


BREAKS: dict[str, Callable[[pd.DataFrame, Rng], pd.DataFrame]] = {
    "no step": lambda t, rng: t.drop(columns="step"),
    "no trial": lambda t, rng: t.drop(columns="trial"),
    "one hypothesis": lambda t, rng: t.drop(
        columns=[n for n in t if n.startswith("ll_") and n != _first_ll(t)]
    ),
    "no rows": lambda t, rng: t.head(0),
    "twice": lambda t, rng: pd.concat([t, t.iloc[[int(rng.integers(len(t)))]]]),
    "a gap": lambda t, rng: t.assign(step=t["step"] * 2 + 3),
    "late": lambda t, rng: t.assign(step=t["step"] + 5),
    "half a step": lambda t, rng: t.assign(step=t["step"] + 0.5),
    "a word": lambda t, rng: _with(t, _first_ll(t), int(rng.integers(len(t))), "much"),
    "infinite": lambda t, rng: _with(t, _first_ll(t), int(rng.integers(len(t))), np.inf),
    "missing": lambda t, rng: _with(t, _first_ll(t), int(rng.integers(len(t))), np.nan),
    "no id": lambda t, rng: _with(t, "trial", int(rng.integers(len(t))), None),
    "no such truth": lambda t, rng: t.assign(truth="nobody"),
    "LL_": lambda t, rng: t.rename(columns={_first_ll(t): _first_ll(t).replace("ll_", "LL_")}),
    "a blank": lambda t, rng: t.rename(columns={_first_ll(t): _first_ll(t) + " "}),
    "no name": lambda t, rng: t.assign(ll_=0.0),
    "ll-": lambda t, rng: t.assign(**{"ll-more": 0.0}),
    "Trial": lambda t, rng: t.rename(columns={"trial": "Trial"}),
    "row": lambda t, rng: t.assign(row=1),
}


def broken_or_not(rng: Rng) -> tuple[pd.DataFrame, bool]:
    """Return a table, valid by half."""
    table, valid = evidence_table(rng), bool(rng.random() < 0.5)
    return (table if valid else BREAKS[pick(rng, *BREAKS)](table, rng)), valid


def in_order(table: pd.DataFrame) -> list[tuple[Any, pd.DataFrame]]:
    """Return the trials of a table, plainly: key and rows by step, as first named."""
    keys = [name for name in ("participant_id", "trial") if name in table]
    groups: dict[Any, list[int]] = {}
    for row, key in enumerate(zip(*(table[name] for name in keys), strict=True)):
        groups.setdefault(key, []).append(row)
    return [(key, table.iloc[rows].sort_values("step")) for key, rows in groups.items()]


def decided(rows: pd.DataFrame, threshold: float, gap: float | None, gain: float = 1.0):
    """Decide a trial in plain NumPy: (choices that are equally good, reading, forced)."""
    columns = [name for name in rows if name.startswith("ll_")]
    total = gain * rows[columns].to_numpy(dtype=float).cumsum(axis=0)
    if gap is None:
        out, level = -log_softmax(total, axis=1), threshold
    else:
        z = total[:, 1] - total[:, 0]
        out, level = np.stack([z, -z], axis=1), -gap / 2
    met = (out <= level + 1e-10).any(axis=1)
    k = int(np.argmax(met)) if met.any() else len(out) - 1
    best = np.flatnonzero(out[k] <= out[k].min() + 1e-9)
    return {columns[i][3:] for i in best}, k + 1, not met.any()


def check_decisions(
    table: pd.DataFrame,
    found: pd.DataFrame,
    threshold: float,
    gap: float | None,
    gain: float = 1.0,
    step_s: float = 0.5,
    forced: bool = True,
) -> None:
    """Hold a trial table to the plain decision of every trial, its ids and its columns."""
    trials = in_order(table)
    assert len(found) == len(trials)
    varying = {"step", "truth", "eye_x"} | {n for n in table if n.startswith("ll_")}
    for (key, rows), one in zip(trials, found.to_dict("records"), strict=True):
        assert str(one["trial"]) == str(key[-1])
        assert table.loc[one["row"], "trial"] == rows["trial"].iloc[0]
        for name in set(table) - varying - {"trial"}:
            mine = f"given_{name}" if name in ("rt", "response", "model") else name
            assert str(one[mine]) == str(rows[name].iloc[0]), name
        choices, reading, late = decided(rows, threshold, gap, gain)
        if late and not forced:
            assert one["undecided"]
            assert np.isnan(one["rt"])
            continue
        assert one["response"] in choices
        assert bool(one["forced"]) == late
        assert one["rt"] == reading * step_s or abs(one["rt"] - reading * step_s) < 1e-9
        assert one["steps"] == reading <= len(rows)
        if "truth" in table:
            assert bool(one["correct"]) == (one["response"] == rows["truth"].iloc[0])


def in_memory(rng: Rng, folder: Path) -> Case:
    """Return a table that is in memory already."""
    table, valid = broken_or_not(rng)

    def check(trials: Any) -> None:
        plain = in_order(table)
        assert list(trials.evidence.readings) == [len(rows) for _, rows in plain]
        columns = [f"ll_{name}" for name in trials.names]
        for k, (key, rows) in enumerate(plain):
            given = rows[columns].to_numpy(dtype=float)
            assert np.array_equal(trials.evidence.log_likelihood[k, : len(rows)], given)
            assert trials.columns["trial"].iloc[k] == key[-1]
            if "truth" in table:
                assert trials.names[trials.evidence.truth[k]] == rows["truth"].iloc[0]
        out = first_crossing(Msprt().run(trials.evidence), np.log(len(columns)) / 2)
        found = trial_table(out, trials, model="m")
        check_decisions(table, found, np.log(len(columns)) / 2, None, step_s=0.001)

    return Case(valid, call=lambda: trials_from_table(table), check=check)


def _written(table: pd.DataFrame, folder: Path, ending: str, rng: Rng) -> Path:
    path = folder / f"mine{ending}"
    path.unlink(missing_ok=True)
    if ending == ".csv":
        table.to_csv(path, index=False)
    else:
        # One type a column, as parquet has it.
        texts = {n: table[n].astype(str) for n in table if table[n].dtype == object}
        table.assign(**texts).to_parquet(path)
    return path


def _read_back(path: Path) -> pd.DataFrame:
    """Return a result, texts as they are written."""
    if path.suffix == ".parquet":
        return read_table(path)
    table = pd.read_csv(path, dtype=str, keep_default_na=False)
    for name in ("rt", "steps", "row"):
        table[name] = pd.to_numeric(table[name].replace("", np.nan))
    table["row"] = table["row"].astype(int)
    for name in ("forced", "undecided"):
        table[name] = table[name] == "True"
    table["correct"] = table["correct"] == "1"
    return table


def table_file(command: str, ending: str) -> Callable[[Rng, Path], Case]:
    """Return the generator of commands on a user's table of one format."""

    def make(rng: Rng, folder: Path) -> Case:
        table, valid = broken_or_not(rng)
        path = _written(table, folder, ending, rng)
        if not valid and ending == ".parquet" and "trial" in table and table["trial"].isna().any():
            # As a word of parquet a missing id would be "None": an empty table stands for it.
            table.drop(columns="ll_left", errors="ignore").iloc[:0].to_parquet(path)
        out = folder / f"out{pick(rng, '.csv', '.parquet')}"
        hypotheses = sum(name.startswith("ll_") for name in table)
        posterior = float(rng.uniform(1 / max(hypotheses, 2) + 0.05, 0.995))
        gap, gain, step_s, forced = None, 1.0, 0.5, True
        given = ["--evidence", str(path)]
        if command == "decide":
            arguments = ["decide", str(out), *given]
            if hypotheses == 2 and rng.random() < 0.5:
                gap = float(rng.uniform(0.1, 8))
                arguments += ["--delta", repr(gap)]
            else:
                arguments += ["--posterior", repr(posterior)]
            if rng.random() < 0.3:
                arguments, forced = [*arguments, "--no-forced"], False
        else:
            gain, step_s = float(rng.uniform(0.3, 1.5)), 0.05
            arguments = ["circuit", "run", str(out), *given, "--engine", "algebra"]
            arguments += ["--circuit", "bogacz_gurney", "--gain", repr(gain)]
            arguments += ["--posterior", repr(posterior)]

        def check() -> None:
            back = _read_back(out)
            given_table = table
            if ending == ".csv":
                given_table = pd.read_csv(path, dtype=str, keep_default_na=False)
                for name in given_table:
                    if name.startswith("ll_") or name == "step":
                        given_table[name] = pd.to_numeric(given_table[name])
            level = -np.log(posterior)
            check_decisions(given_table, back, level, gap, gain, step_s, forced)

        return Case(valid, arguments, check=check)

    return make


# ---- commands


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
        ["--edits.add", f"STN->D2 weight={rng.uniform(0, 0.001):.4f}"],
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
        lesions = pick(rng, ["STN=0.02"], ["D1->SNr=0.99", "D2"], ["STN->GPe[0]=0.99"])
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
    return ["circuit", "learn", _out(rng, folder), *given]


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


# ---- an experiment's file

VALID_TOML = {
    "name": ['"a lesion"', '"x"'],
    "published": ['"faster"', '""'],
    "source": ['"nobody"'],
    "note": ['"a test"', '"""\ntwo\nlines"""'],
    "engine": ['"algebra"'],
    "seed": ["0", "3", "123456"],
    "posterior": ["0.8", "0.7"],
    "foreperiod_ms": ["100.0", "50"],
    "gain": ["0.5", "1"],
}
BROKEN_TOML = [
    ("seed", '"three"'),
    ("seed", "1.5"),
    ("seed", "true"),
    ("posterior", "1.0"),
    ("posterior", "95"),
    ("posterior", '"0.9"'),
    ("foreperiod_ms", "0"),
    ("foreperiod_ms", "inf"),
    ("engine", '"spikes"'),
    ("gains", "1"),
    ("name", "3"),
    ("published", "2026-01-01"),
    ("truth", "7"),
    ("task.trials", "0"),
    ("task.trials", "1e13"),
    ("task.conflict", "1.0"),
    ("task.channels", "1"),
    ("task.period_mm", "2.5"),
    ("task.size", "3"),
    ("manipulation.without", '"STN"'),
    ("manipulation.with_out", '["STN"]'),
    ("manipulation.posterior", "2"),
    ("control.neurons", '"3"'),
    ("predictions.measure", '"speed"'),
    ("predictions.direction", '"left"'),
    ("predictions.at_least", "-1"),
    ("predictions.at_least", "nan"),
]


def toml(rng: Rng, valid: bool) -> str:
    """Return the text of an experiment's file, broken in one place unless valid."""
    top = {name: pick(rng, *values) for name, values in VALID_TOML.items()}
    parts = {
        "task": {"trials": str(rng.integers(100, 300)), "t_max": str(rng.integers(6, 9))}
        | {"d_prime": "2.0"},
        "control": {},
        "manipulation": {"without": f'["STN={rng.uniform(0.005, 0.05):.3f}"]'},
        "predictions": {
            "measure": pick(rng, '"accuracy"', '"mean_ms"', '"missed"'),
            "direction": pick(rng, '"up"', '"down"', '"none"'),
            "at_least": f"{rng.uniform(0.01, 30):.3f}",
        },
    }
    if rng.random() < 0.5:
        top["truth"] = "1"
        parts["task"]["trials"] = "240"
    if not valid:
        place, value = BROKEN_TOML[int(rng.integers(len(BROKEN_TOML)))]
        part, dot, key = place.partition(".")
        (parts[part] if dot else top)[key if dot else place] = value
    lines = [f"{key} = {value}" for key, value in top.items()]
    for name, keys in parts.items():
        if keys:
            lines.append(f"[[{name}]]" if name == "predictions" else f"[{name}]")
            lines += [f"{key} = {value}" for key, value in keys.items()]
    if not valid and rng.random() < 0.2:
        # Or one line is no TOML, or a key that must be there is not.
        gone = [k for k, line in enumerate(lines) if line.startswith(("name", "source", "measure"))]
        lines[pick(rng, *gone)] = pick(rng, "", "= 3", "name = 'open", "[task")
    return "\n".join(lines) + "\n"


def toml_file(rng: Rng, folder: Path) -> Case:
    """Return an experiment's file, to be read."""
    valid = bool(rng.random() < 0.5)
    text = toml(rng, valid)
    path = folder / "mine.toml"
    path.write_text(text)

    def check(found: Any) -> None:
        import tomllib

        plain = tomllib.loads(text)
        assert found.name == plain["name"]
        assert found.task.trials == plain["task"]["trials"]
        assert found.predictions[0].at_least == plain["predictions"][0]["at_least"]
        assert found.manipulation.without == tuple(plain["manipulation"]["without"])
        assert found.seed == plain["seed"]

    return Case(valid, call=lambda: read_experiment(path), check=check)


# ---- a circuit, edited

GOOD_EDITS: dict[str, Callable[[Any, Rng], Any]] = {
    "lesion": lambda c, rng: c.without("STN", rng.uniform(0, 0.1)),
    "replaced": lambda c, rng: c.without("GPe", rng.uniform(0, 1), replaced=True),
    "scale": lambda c, rng: c.scaled("STN", "GPe", rng.uniform(0.9, 1.1)),
    "dopamine": lambda c, rng: c.dopamine(rng.uniform(0.8, 1.2)),
    "delay": lambda c, rng: c.with_projection("STN", "GPe", delay_ms=int(rng.integers(1, 20))),
    "tau": lambda c, rng: c.with_projection("STN", "GPe", tau_ms=rng.uniform(0, 20)),
    "bias": lambda c, rng: c.with_population("D1", bias_nats=c.population("D1").bias_nats + 0.01),
    "neurons": lambda c, rng: c.with_neurons(int(rng.integers(1, 50))),
    "spread": lambda c, rng: c.with_spread(rng.uniform(0, 0.3)),
    "wires": lambda c, rng: c.with_connections(rng.uniform(0.1, 1)),
    "row": lambda c, rng: c.with_rows(
        Population("TRN", pick(rng, Rate(), Phase(1.0), Phase(0.3)), 10.0),
        Projection("STN", "TRN", rng.uniform(0, 2), delay_ms=2),
    ),
    "text": lambda c, rng: c.edited(f"STN->GPe.tau_ms={rng.uniform(0, 20)}"),
    "row in text": lambda c, rng: c.with_rows(f"STN->D1 weight={rng.uniform(0, 1)}"),
    "cite": lambda c, rng: c.with_population("STN", cite="mine"),
}
BAD_EDITS: dict[str, Callable[[Any, Rng], Any]] = {
    "no nucleus": lambda c, rng: c.without("thalamus"),
    "fraction": lambda c, rng: c.without("STN", pick(rng, 1.1, -0.1, np.nan, "half", None)),
    "input": lambda c, rng: c.without(pick(rng, "ctx", "SNr")),
    "no path": lambda c, rng: c.scaled("SNr", "STN", 1.1),
    "factor": lambda c, rng: c.scaled("STN", "GPe", pick(rng, -1, np.nan, np.inf, "2")),
    "channel": lambda c, rng: c.scaled("D1", "SNr", 1.1, channel=pick(rng, 99, -1, "0")),
    "dopamine": lambda c, rng: c.dopamine(pick(rng, -0.1, 2.1, np.nan, "1")),
    "delay": lambda c, rng: c.with_projection(
        "STN", "GPe", delay_ms=pick(rng, -1, 1e9, "4", np.nan)
    ),
    "sign": lambda c, rng: c.with_projection("D1", "SNr", weight=0.5),
    "weight": lambda c, rng: c.with_projection(
        "STN", "GPe", weight=pick(rng, np.inf, "x", None, True)
    ),
    "text": lambda c, rng: c.edited(pick(rng, "STN.bias_nats", "STN.x=1", "", 3, "X.tau_ms=1")),
    "row in text": lambda c, rng: c.with_rows(pick(rng, "X", "D1->X weight=-1", "X like=Y")),
    "field": lambda c, rng: c.with_population("STN", wieght=1.0),
    "neurons": lambda c, rng: c.with_neurons(pick(rng, 0, 2.5, "3", -1, np.nan)),
    "spread": lambda c, rng: c.with_spread(pick(rng, 5, -1, "a", np.nan)),
    "wires": lambda c, rng: c.with_connections(pick(rng, 0, 1.5, "a", np.nan)),
    "rows": lambda c, rng: c.with_rows(pick(rng, "STN", None, 3, {"name": "a"})),
    "name": lambda c, rng: c.with_rows(Population(pick(rng, "", " ", "a->b", 3), Rate())),
    "twice": lambda c, rng: c.with_rows(c.population("STN")),
    "end": lambda c, rng: c.with_rows(Projection("STN", "thalamus", 1.0)),
    "channels": lambda c, rng: c.with_channels(pick(rng, 0, 1, "2", 2.5, np.nan)),
    "cell": lambda c, rng: c.with_population("STN", cell=pick(rng, "Lif", None, 3)),
    "transfer": lambda c, rng: c.with_population("STN", transfer="cube"),
    "pattern": lambda c, rng: c.with_projection("STN", "GPe", pattern="ring"),
    "gain": lambda c, rng: c.with_population("STN", gain_hz_per_nat=pick(rng, 0, -1, "1", np.nan)),
    "engine": lambda c, rng: run(c, np.zeros((1, 1, c.channels)), engine="pen", step_ms=1.0),
    "spikes": lambda c, rng: run(
        c, np.zeros((1, 1, c.channels)), engine="algebra", step_ms=1.0, spikes=("STN",)
    ),
    "step": lambda c, rng: run(
        c, np.zeros((1, 1, c.channels)), engine="algebra", step_ms=pick(rng, 0, "1", np.nan)
    ),
    "drive": lambda c, rng: run(
        c,
        pick(
            rng, "abc", np.zeros((1, 1)), np.zeros((1, 1, 99)), np.full((1, 1, c.channels), np.nan)
        ),
        engine="algebra",
        step_ms=1.0,
    ),
}


def circuit_edit(rng: Rng, folder: Path) -> Case:
    """Return a circuit, to be edited several times and run at the fixed point."""
    name, channels = pick(rng, *anatomy.CIRCUITS), int(rng.integers(2, 7))
    valid = bool(rng.random() < 0.5)
    good = [pick(rng, *GOOD_EDITS) for _ in range(int(rng.integers(3)))]
    bad = pick(rng, *BAD_EDITS)
    drive = rng.uniform(-0.7, 0.7, (3, 1, channels))
    drive -= drive.mean(axis=2, keepdims=True)
    seed = int(rng.integers(2**31))

    def edited() -> Any:
        own = np.random.default_rng(seed)
        circuit = anatomy.circuit(name, channels)
        for edit in good:
            once = edit in ("row", "lesion", "replaced") and good.count(edit) > 1
            absent = edit in ("neurons", "spread", "wires") and name != "spiking_msprt"
            circuit = circuit if once or absent else GOOD_EDITS[edit](circuit, own)
        return circuit

    def call() -> Any:
        circuit = edited()
        if not valid:
            return BAD_EDITS[bad](circuit, np.random.default_rng(seed))
        return circuit, run(circuit, drive, engine="algebra", step_ms=1.0).output_nats

    def check(found: Any) -> None:
        circuit, out = found
        assert out.shape == drive.shape
        assert np.isfinite(out).all()
        # Channels are alike: to exchange them exchanges their OUT.
        order = np.random.default_rng(seed).permutation(channels)
        turned = run(circuit, drive[:, :, order], engine="algebra", step_ms=1.0).output_nats
        assert np.abs(turned - out[:, :, order]).max() < 1e-6
        if circuit.exact:
            plain = logsumexp(drive, axis=2, keepdims=True) - drive
            assert np.abs(out - plain).max() < 1e-6

    return Case(valid, call=call, check=check)


def figures(rng: Rng, folder: Path) -> list:
    """Draw figures."""
    return ["figures", *pick(rng, [], ["fig4a"], ["fig3", "figC1"], ["--fast"])]


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
             ["--engine", "ensemble", "--edits.neurons", "1e12"]],
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
    from bgmodel.cli import main

    taps, decoder = folder / "taps.npz", folder / "decoder.safetensors"
    quick = ["--training.width", "0.1", "--training.epochs", "1", "--training.batch", "8"]
    assert main(["simulate", str(taps), "--taps", "30", "--periods-mm", "0", "5"]) == 0
    assert main(["train", str(taps), str(decoder), *quick]) == 0
