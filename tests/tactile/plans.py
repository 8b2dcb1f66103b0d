"""Small libraries of contacts, taps of them, and the places of a grid."""

import dataclasses

import numpy as np
import pandas as pd

from bgmodel.tactile.pressing import LibraryPlan
from bgmodel.tactile.sensor import Nuisance

GRID = {"dx_mm": 0.25, "stored_dx_mm": 0.5, "tol": 1e-5}
PLAN = LibraryPlan(periods_mm=(0.0, 2.0, 5.0), phases=8, forces_n=(1.2, 1.5, 1.8), **GRID)
TINY = dataclasses.replace(PLAN, periods_mm=(0.0, 4.0), phases=3, forces_n=(1.2, 1.8), dx_mm=0.5)
STILL = Nuisance(offset_sd_mm=0, shear_sd_mm=0, marker_noise_um=0)


def one_tap(period_mm=5.0, yaw_deg=0.0, phase=0.0, force_n=1.5, **others):
    row = {"period_mm": period_mm, "yaw_deg": yaw_deg, "phase": phase, "force_n": force_n}
    places = ["offset_x_mm", "offset_y_mm", "shear_x_mm", "shear_y_mm"]
    return pd.DataFrame([row | dict.fromkeys(places, 0.0) | others])


def places(cells, dx):
    """Return the places of a row of cells about 0, mm."""
    return (np.arange(cells) - (cells - 1) / 2) * dx
