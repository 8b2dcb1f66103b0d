"""The contact solver against Hertz, against an independent solver, and against itself."""

import numpy as np
import pytest

from bgmodel.tactile.contact import polonsky_keer, unfold, wavenumbers
from bgmodel.tactile.pressing import Grating
from bgmodel.tactile.skin import Skin, response
from tests.tactile.plans import places

SHEAR = 0.1


def half_space(shape, dx, mirrored=False):
    k = wavenumbers(shape, dx, mirrored=mirrored)
    return np.divide(1, 2 * SHEAR * k, out=np.zeros_like(k), where=k > 0)


def dome(cells, dx, radius=20.0, mirrored=False):
    x = places(cells, dx)
    return (x[:, None] ** 2 + x[cells // 2 if mirrored else 0 :] ** 2) / (2 * radius)


def test_a_sphere_on_a_half_space_presses_as_hertz_says():
    cells, side, wanted = 512, 32.0, 4.0
    dx, stiffness = side / cells, 4 * SHEAR  # E* = E / (1 - nu^2) = 4G
    # A periodic contact has neighbours, which press the skin down around it: the sphere acts as a
    # smaller one. Sum of 1/R^3 over the square lattice: 9.0336 / side^3; Laplacian of 1/r: 1/r^3.
    bend = 16 * SHEAR * wanted**3 / 3 * 9.0336 / (8 * np.pi * SHEAR * side**3)
    radius = 20.0 / (1 - bend)  # of the sphere that is pressed; it acts as one of 20 mm
    load = 4 * stiffness * wanted**3 / (3 * 20.0)
    surface = dome(cells, dx, radius, True), half_space((cells, cells // 2), dx, True)
    half = polonsky_keer(*surface, load, dx, tol=1e-8, mirrored=True)
    pressure, r = unfold(half), np.sqrt(2 * dome(cells, dx, 1.0))
    peak = 2 * stiffness * wanted / (np.pi * 20.0)
    assert pressure.max() == pytest.approx(peak, rel=1e-3)
    inner = r < 0.95 * wanted
    slope, top = np.polyfit(r[inner] ** 2, pressure[inner] ** 2, 1)
    assert np.sqrt(-top / slope) == pytest.approx(wanted, rel=1e-3)
    assert np.count_nonzero(pressure) * dx**2 == pytest.approx(np.pi * wanted**2, rel=4e-3)
    profile = peak * np.sqrt(np.maximum(1 - (r / wanted) ** 2, 0))
    assert np.abs(pressure - profile)[inner].max() < 1e-3 * peak


@pytest.mark.parametrize("period_mm", [0.0, 2.0])
def test_pressure_bears_the_load_and_acts_only_where_the_gap_is_closed(period_mm):
    cells, dx = 128, 0.25
    groove, _ = Grating(period_mm).on_grid(cells, dx)
    gap = dome(cells, dx) + groove[:, None]
    kernel = response(Skin(), wavenumbers(gap.shape, dx)).compliance
    pressure = polonsky_keer(gap, kernel, 1.5, dx)
    assert pressure.sum() * dx**2 == pytest.approx(1.5, rel=1e-12)
    assert pressure.min() == 0
    spectrum = np.fft.rfft2(pressure.T) * kernel.T
    clearance = gap + np.fft.irfft2(spectrum, s=gap.shape).T
    approach = clearance[pressure > 0].mean()
    assert np.abs(clearance - approach)[pressure > 0].max() < 1e-3
    assert (clearance - approach)[pressure == 0].min() > -1e-4
    assert approach == pytest.approx(1.86, abs=0.02)


def test_pressure_is_that_of_an_independent_solver():
    tm = pytest.importorskip("tamaas")
    cells, dx, load = 128, 0.25, 1.5
    groove, _ = Grating(3.0, phase=0.2).on_grid(cells, dx)
    gap = dome(cells, dx) + groove[:, None]
    model = tm.ModelFactory.createModel(tm.model_type.basic_2d, [cells * dx] * 2, [cells] * 2)
    model.E, model.nu = 3 * SHEAR, 0.5
    tm.PolonskyKeerRey(model, -gap, 1e-12).solve(load / (cells * dx) ** 2)
    ours = polonsky_keer(gap, half_space(gap.shape, dx), load, dx, tol=1e-8)
    assert np.linalg.norm(ours - model.traction) < 1e-3 * np.linalg.norm(model.traction)


def test_mirrored_surface_and_start_change_nothing():
    cells, dx = 64, 0.5
    groove, _ = Grating(4.0).on_grid(cells, dx)
    gap = dome(cells, dx) + groove[:, None]
    pressure = polonsky_keer(gap, half_space(gap.shape, dx), 1.0, dx, tol=1e-9)
    kernel = half_space((cells, cells // 2), dx, True)
    half = polonsky_keer(gap[:, cells // 2 :], kernel, 1.0, dx, tol=1e-9, mirrored=True)
    assert unfold(half) == pytest.approx(pressure, abs=1e-5 * pressure.max())
    start = np.roll(pressure, 3, axis=0)
    again = polonsky_keer(gap, half_space(gap.shape, dx), 1.0, dx, tol=1e-9, start_mpa=start)
    assert again == pytest.approx(pressure, abs=1e-5 * pressure.max())


def test_no_convergence_is_an_error():
    with pytest.raises(RuntimeError, match="after 3 iterations"):
        polonsky_keer(dome(32, 1.0), half_space((32, 32), 1.0), 1.0, 1.0, max_iterations=3)
