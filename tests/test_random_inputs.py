"""A share of the random inputs that `make validate` tries."""

import os

from tests.fuzzing.trying import all_tried

SHARE = float(os.environ.get("FUZZ_SHARE", 0.01))
"""Share of the inputs that `make test` tries."""


def test_some_random_inputs_give_a_result_or_one_sentence(tmp_path, monkeypatch, capsys):
    counts, _ = all_tried(SHARE, tmp_path, monkeypatch, capsys)
    assert counts["checked"] >= 50 * SHARE / 0.01
