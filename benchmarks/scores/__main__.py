"""Compute all scores: make score, python -m benchmarks.scores."""

from benchmarks.scores import (
    agreement,
    experiments,
    learning,
    lesions,
    levels,
    limits,
    loss,
    parts,
    population,
    raw,
    sensitivity,
)
from benchmarks.scores.pieces import main

MODULES = (
    raw,
    parts,
    agreement,
    limits,
    lesions,
    loss,
    levels,
    learning,
    experiments,
    sensitivity,
    population,
)

if __name__ == "__main__":
    main(*(module.SCORE for module in MODULES))
