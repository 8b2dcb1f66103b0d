"""What is checked before a commit is what `make lint` checks."""

import re

import yaml

from tests.helpers import ROOT


def test_the_hooks_are_the_lines_of_make_lint():
    config = yaml.safe_load((ROOT / ".pre-commit-config.yaml").read_text())
    hooks = [hook["entry"] for repo in config["repos"] for hook in repo["hooks"]]
    lint = re.search(r"^lint:.*\n((?:\t.*\n)+)", (ROOT / "Makefile").read_text(), re.MULTILINE)
    assert lint is not None
    assert hooks == re.sub(r"\t\$\(BIN\)", ".venv/bin", lint[1]).splitlines()
