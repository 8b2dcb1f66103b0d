"""Random inputs are tried: each gives a result that an oracle confirms, or one sentence."""

import shutil
import time
import warnings
from collections import Counter

import pytest

from bgmodel.cli import main
from bgmodel.support.seeds import stream
from tests.fuzzing.kinds import KINDS, prepare

SEED = 18
LIMIT_S = 30.0
"""Stated time of an input, of this process's CPU: the first run of a kind of circuit compiles."""


def cases(kind, share):
    """Return numbers and generators of the inputs of a kind, so many of them."""
    count, make = KINDS[kind]
    return range(max(round(count * share), 4)), make


def tried(kind, k, make, folder, capsys):
    """Try one input; return whether it was valid and held to an oracle, and the case."""
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir()
    case = make(stream(SEED, "fuzz", kind, k), folder)
    before = sorted(path.name for path in folder.rglob("*"))
    started = time.process_time()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        if case.arguments is not None:
            result = None
            status = main(case.arguments)
            said = capsys.readouterr().err
            assert status == (0 if case.valid else 2), said
            assert "Traceback" not in said
            if not case.valid:
                check_sentence(said, case.words)
                assert sorted(path.name for path in folder.rglob("*")) == before
        elif case.valid:
            result = case.call()
        else:
            with pytest.raises(ValueError, match=r"^[^\n]{10,}$"):
                case.call()
    assert time.process_time() - started < LIMIT_S, "longer than its stated time"
    if case.valid and case.check is not None:
        case.check(*([] if result is None else [result]))
    return case


def check_sentence(said, words=()):
    """Hold the last line to a sentence of the command that says what is wrong."""
    last = said.strip().splitlines()[-1]
    assert last.startswith("bgmodel: "), said
    assert 20 < len(last) < 400, said
    assert not words or any(word in last for word in words), (last, words)


def all_tried(share, tmp_path, monkeypatch, capsys):
    """Try inputs of every kind; return the counts, and the cases that are commands."""
    root = figures_without_snakemake(tmp_path, monkeypatch)
    counts, commands, failed = Counter(), [], []
    for kind in KINDS:
        numbers, make = cases(kind, share)
        for k in numbers:
            try:
                case = tried(kind, k, make, root / "here", capsys)
            except BaseException as error:  # also what pytest and the system raise
                if isinstance(error, KeyboardInterrupt):
                    raise
                failed.append(f"{kind} {k}: {type(error).__name__} {str(error)[:300]}")
                capsys.readouterr()
                continue
            counts[kind, case.valid] += 1
            counts["checked"] += case.valid and case.check is not None
            if case.arguments is not None and kind != "figures":
                commands.append((kind, k))
    with capsys.disabled():
        print(f"\n{sum(v for k, v in counts.items() if k != 'checked')} inputs, {dict(counts)}")
    assert not failed, "\n".join(failed[:20])
    return counts, commands


def figures_without_snakemake(tmp_path, monkeypatch):
    """Return a folder to work in, where `bgmodel figures` checks and starts nothing."""
    shutil.copytree("figures", tmp_path / "figures", ignore=shutil.ignore_patterns("out", "fast"))
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("BGMODEL_RECORDINGS", raising=False)
    monkeypatch.setattr("bgmodel.commands.one_run.run_to_end", lambda *given: 0)
    prepare(tmp_path)
    return tmp_path
