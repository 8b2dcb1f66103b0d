"""What makes no sense is refused by the name of its field, everywhere on the way of a tap."""

from functools import partial

import numpy as np
import pandas as pd
import pytest

from bgmodel.tactile.contact import polonsky_keer
from bgmodel.tactile.decoder import Training
from bgmodel.tactile.library import contact_library
from bgmodel.tactile.likelihood import Density
from bgmodel.tactile.pressing import Grating, LibraryPlan
from bgmodel.tactile.sensor import Nuisance
from bgmodel.tactile.skin import Skin, Tip, render, response
from bgmodel.tactile.source import source
from bgmodel.tactile.task import EdgeDirection, EdgeTurn, Orientation
from tests.helpers import refused, refusing
from tests.tactile.plans import TINY

NAN, INF = np.nan, np.inf
NONE = [0.0, -1.0, NAN]
FLAT = partial(
    polonsky_keer, gap_mm=np.zeros((16, 16)), compliance=np.ones((9, 16)), load_n=1.0, dx_mm=1.0
)
WRONG = {
    Tip: {"layout": ["round"], "pitch_mm": [0.0, INF], "pin_mm": [-0.1], "camera_height_mm": [0.0]},
    Skin: {"skin_mm": NONE, "skin_shear_mpa": NONE, "gel_mm": NONE, "gel_shear_mpa": NONE},
    Nuisance: {
        "force_n": [(1.8, 1.2)], "marker_noise_um": [-1.0], "noise_per": ["pin"], "frames": [0],
    },
    LibraryPlan: {
        "phases": [1], "forces_n": [(1.5, 1.2), (1.5,), (0.0, 1.5)], "dx_mm": [0.3],
        "stored_dx_mm": [0.3], "radius_mm": [NAN, -20.0], "tol": [0.0], "field_side_mm": [34.0],
    },
    partial(Grating, 1.0): {"depth_mm": [INF], "phase": [NAN]},
    FLAT: {
        "gap_mm": [np.zeros(4), np.full((16, 16), NAN)], "load_n": [0.0], "dx_mm": [-1.0],
        "compliance": [np.ones((16, 16)), -np.ones((9, 16))], "tol": [NAN],
        "start_mpa": [np.zeros((16, 16))],
    },
    partial(response, Skin()): {"wavenumber_per_mm": [-1.0, [1.0, NAN]]},
    partial(render, 0): {"marker_mm": [5.0], "shape": [(15, 16)]},
    render: {"displacement_mm": [np.zeros((3, 2))]},
    partial(contact_library, TINY): {"workers": [0]},
    Density: {"kind": ["histogram"], "cap_nats": [0], "shrink": [2]},
    Training: {
        "width": [0], "epochs": [0], "validation": [0.0, 1.0], "dropout": [-0.1, 2.1],
        "learning_rate": [0.0], "network": ["forest"],
    },
    Orientation: {"channels": [9]},
    EdgeTurn: {"channels": [9], "step_deg": [0.0]},
    partial(EdgeDirection, 4): {"step_deg": [91.0]},
    Grating: {"period_mm": [-1.0]},
}  # fmt: skip
"""Calls, and values of their arguments that each of them refuses by the name of the argument."""


@pytest.mark.parametrize("call", WRONG, ids=lambda call: getattr(call, "func", call).__name__)
def test_what_makes_no_sense_is_refused_by_the_name_of_its_field(call):
    for field, values in WRONG[call].items():
        for value in values:
            with refused(field):
                call(**{field: value})


FEW_EDGES = pd.DataFrame({"yaw_deg": np.arange(-180.0, 180.0, 6.0)}).assign(
    edge_deg=lambda taps: taps["yaw_deg"]
)


test_fields_that_do_not_fit_together_are_refused = refusing(
    (lambda: LibraryPlan(stored_dx_mm=0.0625), "dx_mm stored_dx_mm must not be smaller"),
    (lambda: LibraryPlan(periods_mm=(1.1,)), "period_mm"),
    (lambda: Grating(1.0).on_grid(64, 0.2), "period_mm"),
    (
        lambda: source(pd.DataFrame({"psi_deg": [1.0]}), EdgeTurn()),
        "taps an edge, with yaw_deg, edge_deg",
    ),
    (lambda: source(FEW_EDGES, EdgeTurn()), "pool too few"),
)
