"""Power spectra of rates and the variance of OUT in closed form.

Linear noise of finitely many cells about the fixed point, at rest or at a constant drive, including
nonlinear pathways (``circuits.laws.fluctuation``). They predict ``Activity.spectrum`` and the
variability of OUT across trials.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from circuits.arrays import Array
from circuits.declaration.table import CircuitTable
from circuits.dynamics.fixed_point import held_drive, solve, wired
from circuits.dynamics.wiring import Wiring
from circuits.errors import require
from circuits.laws.fluctuation import FREQUENCIES_HZ, extra, linear, swept
from circuits.laws.mean_field import settled


def rate_spectrum(
    circuit: CircuitTable,
    name: str,
    frequency_hz: npt.ArrayLike,
    drive: npt.ArrayLike | None = None,
) -> Array:
    """Return the one-sided power (F,), Hz^2/Hz, of a population's rate averaged over channels.

    Frequencies are at least 1e-3 Hz; the drive (channels,), nats, is constant, by default rest.
    Raises ValueError for a circuit with courses or an unstable fixed point, and where there is no
    theory of its noise: see ``fluctuation.extra``.
    """
    frequency = np.asarray(frequency_hz, dtype=np.float64)
    lowest = FREQUENCIES_HZ[0]
    least = f"must be {lowest:g} or more"
    require((frequency >= lowest).all(), "frequency_hz", least, frequency.min())
    wiring = wired(circuit)
    x, extra_hz = _state(wiring, drive)
    swept(wiring, x, extra_hz)  # raises if there is no spectrum
    fluctuations = linear(wiring, x, frequency, extra_hz)
    out, noise = fluctuations.out[0], fluctuations.noise[0]
    mean = out[:, wiring.blocks_of(name)].mean(axis=1)
    return np.asarray(2 * (np.abs(mean) ** 2 * noise).sum(axis=1))


def out_variance(
    circuit: CircuitTable, drive: npt.ArrayLike | None = None, *, mean_ms: float = 0.0
) -> dict[str, Array]:
    """Return the variance of OUT (channels,), nats^2, contributed by each population's noise.

    OUT is averaged over ``mean_ms`` after the read-out filter; the drive is that of
    ``rate_spectrum``.
    """
    wiring = wired(circuit)
    frequency, fluctuations = swept(wiring, *_state(wiring, drive))
    out, noise = fluctuations.out[0], fluctuations.noise[0]
    read = wiring.blocks_of(circuit.readout)
    power = np.abs(out[:, read]) ** 2 * noise[:, None] / wiring.gain_hz_per_nat[read][:, None] ** 2
    turn = 2 * np.pi * frequency * circuit.readout_tau_ms / 1000
    seen = np.sinc(frequency * mean_ms / 1000) ** 2 / (1 + turn**2)
    # Two-sided: negative frequencies contribute as much.
    variance = 2 * np.trapezoid(power * seen[:, None, None], frequency, axis=0)
    return {
        row.name: variance[:, wiring.blocks_of(row.name)].sum(axis=1)
        for row in circuit.populations
        if row.spiking
    }


def count_ratio(circuit: CircuitTable, name: str) -> float:
    """Return the variance of one cell's spike counts over their mean, at rest, in long windows.

    For intervals that are independent this is the square of their coefficient of variation (Cox
    1962). Variability that cells share by the circuit's feedback is not in it.
    """
    wiring = wired(circuit)
    blocks = wiring.blocks_of(name)
    x = solve(wiring, held_drive(wiring, None))
    noise = linear(wiring, x, FREQUENCIES_HZ[:1]).noise[0, 0, blocks].mean()
    rate = wiring.rates(x)[0, blocks].mean()
    return float(noise * circuit.population(name).neurons / rate)


def _state(wiring: Wiring, drive: npt.ArrayLike | None) -> tuple[Array, Array]:
    """Return the state (1, blocks), nats, with finite-size shifts, and the shifts of rates, Hz."""
    wiring.circuit.check_steady("its noise in closed form")
    held = held_drive(wiring, drive)
    start = settled(wiring, held, solve(wiring, held))
    added = extra(wiring, start)
    return settled(wiring, held, start, *added), added.rates_hz
