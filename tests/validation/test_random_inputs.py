"""Ten thousand random inputs: make validate."""

import shutil
import subprocess
import sys

import numpy as np
import pytest

from bgmodel.support.seeds import stream
from tests.fuzzing.kinds import KINDS
from tests.fuzzing.trying import SEED, all_tried, check_sentence

AS_COMMANDS = 200
ORACLES = 2000


@pytest.mark.validate
def test_random_inputs_give_a_result_or_one_sentence(tmp_path, monkeypatch, capsys):
    counts, commands = all_tried(1.0, tmp_path, monkeypatch, capsys)
    number = {kind: counts[kind, True] + counts[kind, False] for kind in KINDS}
    assert sum(number.values()) >= 10_000
    assert counts["checked"] >= ORACLES
    for kind, count in number.items():
        assert count >= 200, kind
        assert 0.35 < counts[kind, True] / count < 0.65, kind
    chosen = stream(SEED, "fuzz", "commands").permutation(len(commands))[:AS_COMMANDS]
    for n in np.sort(chosen):
        kind, k = commands[n]
        folder = tmp_path / "here"
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir()
        case = KINDS[kind][1](stream(SEED, "fuzz", kind, k), folder)
        done = subprocess.run(
            [sys.executable, "-c", "import sys; from bgmodel.cli import main; sys.exit(main())",
             *case.arguments],
            capture_output=True, text=True, check=False, timeout=60,
        )  # fmt: skip
        assert done.returncode == (0 if case.valid else 2), (case.arguments, done.stderr)
        assert "Traceback" not in done.stderr
        if case.valid and case.check is not None:
            case.check()
        elif not case.valid:
            check_sentence(done.stderr, case.words)
