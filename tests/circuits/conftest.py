"""Fixtures of the tests of circuits."""

import pytest

from circuits import anatomy
from circuits.cells import CELLS
from circuits.engines.spikes import cells as compiled_cells


@pytest.fixture(autouse=True)
def registry():
    """Cell types that a test registers go with it."""
    kept, loops = dict(CELLS), dict(compiled_cells._LOOPS)
    yield
    for known, before in ((CELLS, kept), (compiled_cells._LOOPS, loops)):
        known.clear()
        known.update(before)


@pytest.fixture(params=sorted(anatomy.CIRCUITS))
def circuit(request):
    return anatomy.load_circuit(request.param)
