"""The notice about compiling: shown once, and only if something is compiled."""

import numba

from bgmodel.support.compiling import on_compiling


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
    compile_as("bgmodel.deciding.crossing")
    assert told == []
    compile_as("circuits.engines.kernel")
    compile_as("circuits.engines.kernel")
    assert told == ["second"]
