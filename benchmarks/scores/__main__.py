"""Compute all scores: make score, python -m benchmarks.scores."""

from benchmarks import hssm_check
from benchmarks.scores import (
    agreement,
    calibrated,
    conflict,
    crosschecks,
    experiments,
    fits,
    hick,
    learning,
    lesions,
    levels,
    likelihood,
    limits,
    loss,
    others,
    parts,
    population,
    posteriors,
    printed,
    published,
    raw,
    recovery,
    sensitivity,
    stimulation,
    worst,
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
    posteriors,
    fits,
    stimulation,
    conflict,
    recovery,
    sensitivity,
    worst,
    population,
    likelihood,
    hssm_check,
    published,
    crosschecks,
    hick,
    calibrated,
    printed,
    others,
)

if __name__ == "__main__":
    main(*(module.SCORE for module in MODULES))
