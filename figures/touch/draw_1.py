"""Figure 1: the sensor, its pins, its response to gratings, and decoder versus humans."""

from __future__ import annotations

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from bgmodel import stream
from bgmodel.plots import accuracy_axis, wilson
from bgmodel.support.files import read_table, write_table
from bgmodel.tactile.library import contact_library
from bgmodel.tactile.sensor import Nuisance, noiseless, simulate
from bgmodel.tactile.skin import Tip, render
from bgmodel.tactile.taps import Taps
from figures.common import Settings, letter

YAW_DEG = 45.0
SCALE_UM = 20.0
INSIDE = {"color": "w", "fontsize": 6, "ha": "center"}
HUMAN_GROOVE_MM = {"finger": 0.94, "lip": 0.51, "tongue": 0.58}
"""Grating orientation thresholds at 75 % correct: groove width (Van Boven & Johnson 1994)."""
TITLE = {"fontsize": 8, "fontweight": "bold"}


def compute(settings: Settings, done: Path, *, output: Path) -> None:
    """Tap every grating at many phases without noise to measure the signal at the pins."""
    nuisance = Nuisance(marker_noise_um=0, offset_sd_mm=0, shear_sd_mm=0, force_n=(1.5, 1.5))
    contacts, rows = contact_library(), []
    for period in settings.periods_mm:
        rng, periods = stream(settings.seed, "fig1", period), np.full(64, period)
        taps = simulate(periods, YAW_DEG, rng=rng, nuisance=nuisance, library=contacts)
        size = np.linalg.norm(taps.displacement_mm, axis=2)
        # Changes between phases at one place are due to the grating alone.
        modulation = np.sqrt(2) * (size - size.mean(axis=0)).std(axis=0).mean()
        rows.append({"period_mm": period, "modulation_um": 1000 * modulation})
    write_table(pd.DataFrame(rows), output, seed=settings.seed, nuisance=nuisance)


def draw(settings: Settings, data: Path, taps: Path, *, output: Path) -> Figure:
    """Draw camera and pins above, maps, response and psychometric curve below."""
    figure = plt.figure(figsize=(7.2, 5.0), layout="constrained")
    top, bottom = figure.subfigures(2, 1, height_ratios=[1, 1.1], squeeze=False)[:, 0]
    left, right = top.subfigures(1, 2, width_ratios=[1.15, 1.6])
    pins = _example(settings)
    ax = left.subplots()
    ax.imshow(render(pins.displacement_mm[0], Tip()), cmap="gray")
    ax.set_axis_off()
    letter(ax, "a  camera (simulated)")
    axes = right.subplots(2, 4)
    size = 1000 * np.linalg.norm(pins.displacement_mm, axis=2).reshape(-1, 19, 19)
    axes.flat[0].imshow(size[0], vmin=0)
    axes.flat[0].text(
        0.5, 0.02, f"0 to {size[0].max():.0f} µm", **INSIDE, transform=axes.flat[0].transAxes
    )
    for ax, image in zip(axes.flat[1:], size[1:] - size[0], strict=True):
        shown = ax.imshow(image, cmap="RdBu_r", vmin=-SCALE_UM, vmax=SCALE_UM)
    for ax, period in zip(axes.flat, settings.periods_mm, strict=True):
        ax.set_axis_off()
        ax.set_title(f"{period:g} mm" if period else "smooth", fontweight="normal", loc="center")
    right.colorbar(shown, ax=axes, shrink=0.7, label="grating minus smooth (µm)")
    right.suptitle(
        "b  |displacement| of the pins: smooth; each grating minus smooth", x=0.42, **TITLE
    )
    panels = bottom.subplots(1, 2)
    _response(panels[0], read_table(data))
    _decoder(panels[1], read_table(taps))
    return figure


def _example(settings: Settings) -> Taps:
    """Return one tap per grating, all at the same place, without marker noise."""
    labels = pd.DataFrame({"period_mm": settings.periods_mm, "yaw_deg": YAW_DEG, "phase": 0.0})
    labels["force_n"] = 1.5
    labels[["offset_x_mm", "offset_y_mm", "shear_x_mm", "shear_y_mm"]] = 0.0
    moved = noiseless(labels, Tip(), contact_library())
    return Taps(moved, Tip().rest_mm(), labels)


def _response(ax: Axes, table: pd.DataFrame) -> None:
    grooved = table[table["period_mm"] > 0]
    ax.semilogy(
        grooved["period_mm"] / 2, grooved["modulation_um"], "o-", label="one grating, at the pins"
    )
    ax.axhline(Nuisance().marker_noise_um, color="k", ls=":", lw=1, label="marker noise (assumed)")
    ax.set(xlabel="groove width (mm)", ylabel="modulation of |displacement| (µm)")
    ax.legend(loc="lower right")
    letter(ax, "c  SA-I analogue: response of the pins")


def _decoder(ax: Axes, table: pd.DataFrame) -> None:
    """Draw how often the sign of the decoded angle discriminates -45 from 45 degrees."""
    both = table[np.isclose(np.abs(table["yaw_deg"]), 45)]
    right = (both["psi_deg"] > 0) == (both["yaw_deg"] > 0)
    scored = right.groupby(both["period_mm"]).agg(["sum", "size"])
    p = scored["sum"] / scored["size"]
    low, high = wilson(scored["sum"], scored["size"])
    error = np.clip([p - low, high - p], 0, None)
    ax.errorbar(scored.index / 2, p, error, capsize=2, color="C1", label="decoder, one tap")
    accuracy_axis(ax)
    human_thresholds(ax)
    ax.plot([], [], color="0.8", lw=0.8, label="chance")
    ax.set(xlabel="groove width (mm)", ylim=(0.4, 1.02))
    ax.legend(loc="center right")
    letter(ax, "d  orientation from one tap; humans")


def human_thresholds(ax: Axes, level: float = 0.75) -> Axes:
    """Mark human grating-orientation thresholds on an axis of groove width, mm."""
    for marker, (site, groove) in zip("o^s", HUMAN_GROOVE_MM.items(), strict=True):
        ax.plot(groove, level, marker, color="0.3", mfc="w", ms=5, label=f"human {site}")
    return ax
