"""The notice about compiling, shown only if something is compiled, and the exponential."""

import numba
import numpy as np

from bgmodel.support.compiling import LOWEST, compiled, exponential, on_compiling


def compile_as(module):
    """Compile a function as if it were in a module."""

    def double(x):
        return 2 * x

    double.__module__ = module
    numba.njit(double)(1.0)


def test_compiling_an_engine_is_told_once_and_nothing_else_is():
    told = []
    on_compiling(lambda: told.append("first"))
    on_compiling(lambda: told.append("second"))
    compile_as("bgmodel.deciding.kernel")
    assert told == []
    compile_as("circuits.engines.kernel")
    compile_as("circuits.engines.kernel")
    assert told == ["second"]


def _of_each(x):
    powers = np.empty_like(x)
    for i in range(len(x)):
        powers[i] = exponential(x[i])
    return powers


of_each = compiled(_of_each)


def test_the_exponential_is_within_two_units_in_the_last_place():
    x = np.concatenate([np.linspace(LOWEST, 700, 400_001), np.linspace(-1e-3, 1e-3, 1001)])
    assert np.abs(of_each(x) / np.exp(x) - 1).max() <= 2 * np.finfo(float).eps
