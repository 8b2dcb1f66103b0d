"""Compute all scores: make score, python -m benchmarks.scores."""

from importlib import import_module
from pkgutil import iter_modules

from benchmarks import hssm_check, scores
from benchmarks.scores.pieces import main

NAMES = [name for _, name, _ in iter_modules(scores.__path__) if name != "__main__"]
FOUND = [import_module(f"benchmarks.scores.{name}") for name in NAMES]
MODULES = (*(module for module in FOUND if hasattr(module, "SCORE")), hssm_check)
"""All modules with a score: those of this folder, and one outside it."""

if __name__ == "__main__":
    main(*(module.SCORE for module in MODULES))
