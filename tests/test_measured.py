"""The page on measuring names the seeds that the code draws with."""

import re

from tests.helpers import ROOT


def test_every_seed_that_scores_or_tunes_is_named():
    text = (ROOT / "docs" / "measured.md").read_text()
    seeds = text.partition("## Seeds")[2].partition("## Intervals")[0]
    named = {int(number) for number in re.findall(r"\b\d{3,5}\b", seeds)}
    file_of_seed = {}
    for path in [
        *(ROOT / "benchmarks").rglob("*.py"),
        *(ROOT / "figures").rglob("*.py"),
        *(ROOT / "tests/validation").glob("*.py"),
    ]:
        for line in re.findall(r"^[A-Z_]*SEEDS? = .*$", path.read_text(), re.MULTILINE):
            for number in re.findall(r"\b\d[\d_]{2,}\b", line):
                # The end of a range is not drawn.
                value = int(number) - line.startswith("SCORING_SEEDS = range") * (number == "121")
                file_of_seed[value] = path.name
    assert len(file_of_seed) > 5
    assert {number: name for number, name in file_of_seed.items() if number not in named} == {}
