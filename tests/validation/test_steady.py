"""What lesions shift in spikes is in the cells' own laws, not only in lines."""

import numpy as np
import pytest

from circuits.anatomy import load_circuit
from tests.integrators.helpers import shifts

pytestmark = pytest.mark.validate
SEED = 51
TABLE = load_circuit("spiking_msprt", 4)


def test_what_lines_miss_of_a_lesion_is_in_the_cells_own_laws_and_their_number():
    edited = {"STN": TABLE.lesion("STN", 0.2), "GPe": TABLE.clamp("GPe")}
    shifted = shifts(TABLE, edited, [1.75, 2.75], seed=SEED, trials=10)
    assert (np.abs(shifted["value"] - shifted["finite"]) < 0.005).all()
    line_misses = np.abs(shifted["value"] - shifted["exact"])
    assert line_misses.max() > 0.03
