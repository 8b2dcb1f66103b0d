"""Tables of cells' responses by input: their f-I curve, and the filters of rate and noise."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import numpy.typing as npt

from circuits.arrays import Array, Arrays
from circuits.cells.cell import Cell, Line, Response
from circuits.declaration import transfer
from circuits.engines.compiling import SOURCES
from circuits.engines.population import filters
from circuits.engines.population.kernel import COEFFICIENTS, FOLLOWING, TRANSFERS
from circuits.laws.mean_field import mean_rate_hz, mean_response
from circuits.store import cached

STATES, STEPS, POINTS = 28, 512, 8192
"""Numbers of inputs at which filters are fitted, their coefficients stored, and laws tabulated
(f-I curves and transfers)."""
LEAST_HZ, MOST_HZ, TOP_HZ = 1e-3, 400.0, 1000.0
"""Lowest and highest rate, Hz, between which filters vary with the input, and highest tabulated."""
SLOWEST_HZ = 0.1
"""Rate, Hz, below which filters are constant, because all cells are nearly Poisson there."""
FAR_NATS = 256.0
"""Largest magnitude of an input that is considered, nats."""
ROUGH, SEEN_HZ = 0.25, (1.0, 120.0)
"""Misfit of a filter above which a warning is issued, and the range of rates that is checked."""
LEAST_POWER = 1e-6
"""Least power of noise at a frequency, relative to the rate."""
OF_LIMIT = 0.95
"""Fraction of the highest rate up to which a law is tabulated; it is linear beyond."""
SHARE = 1e-3
"""Margin of rates from their limits, as a fraction of their range."""
BENT = 2e-3
"""Largest interpolation error between two points, as a fraction of the highest value."""


@dataclass(frozen=True)
class Answers:
    """Responses of a population's cells between two inputs, nats."""

    lowest: float  # input from which filters vary with the input
    highest: float  # input up to which they do
    top: float  # input up to which rates are tabulated
    hz: Array  # (POINTS,) rate at evenly spaced inputs from ``lowest`` to ``top``
    # (COEFFICIENTS, STEPS), of the rate's filter and of the two sections of the noise's filter, at
    # evenly spaced inputs from ``lowest`` to ``highest``
    rows: Array
    lags: bool  # whether rates lag behind their input
    # a warning if a filter deviates from theory or the cells have no noise; otherwise empty
    rough: str


@dataclass(frozen=True)
class Mixture:
    """Cells of a population, which may be heterogeneous (``laws.mean_field``), and its line."""

    cell: Cell
    transfer: str
    baseline_hz: float
    gain_hz_per_nat: float
    heterogeneity: float = 0.0

    def at(self, x: Array) -> Line:
        """Return the line at inputs x (S,)."""
        law, gain = transfer.named(self.transfer), self.gain_hz_per_nat
        hz = np.maximum(self.baseline_hz + gain * law(x), self.cell.lowest_hz)
        return Line(hz, gain * law.slope(x), gain * law.curvature(x))

    def rate_hz(self, x: Array) -> Array:
        """Return the mean rate at inputs x (S,), Hz."""
        return mean_rate_hz(self.cell, self.heterogeneity, x, self.at(x).hz)

    def response(self, x: Array, frequency_hz: Array) -> Response:
        """Return the mean response at inputs x (S,), at frequencies (F,)."""
        return mean_response(self.cell, self.heterogeneity, x, self.at(x), frequency_hz)


@lru_cache(maxsize=256)
def answers(mixture: Mixture, dt_ms: float) -> Answers:
    """Return the responses of a population's cells; ValueError if one is not implemented."""
    fitted, rate = _fitted(mixture), mixture.rate_hz
    low, high, top = map(float, fitted["ends"])
    steps, paces = np.linspace(low, high, STEPS), fitted["paces"]
    pace = _pace(rate(steps))
    rows, rough = np.zeros((COEFFICIENTS, STEPS)), ""

    def at_steps(coefficients: Array) -> Array:
        return np.array([np.interp(pace, paces, column) for column in coefficients.T]).T

    if lags := bool(fitted["following"].size):
        rows[:FOLLOWING] = filters.propagated(at_steps(fitted["following"]), dt_ms)
        what = "how its rate follows an input"
        rough = _rough(mixture.cell, what, fitted["hz"], fitted["following_misfit"])
    if fitted["colour"].size:
        # Interpolated as powers of the rate, because those of a pacemaker are such powers.
        sections = np.exp(at_steps(np.log(fitted["colour"])))
        rows[FOLLOWING:] = np.concatenate([filters.sampled(sections[:, :4], dt_ms),
                                           filters.sampled(sections[:, 4:], dt_ms)])  # fmt: skip
        rough = rough or _rough(mixture.cell, "its noise", fitted["hz"], fitted["colour_misfit"])
    else:
        rough = f"{mixture.cell} fires like a clock: the population engine gives it no noise"
    return Answers(low, high, top, rate(np.linspace(low, top, POINTS)), rows, lags, rough)


def _fitted(mixture: Mixture) -> Arrays:
    """Return the fits of a population's cells, kept between runs if all its code is included."""
    import scipy

    included = type(mixture.cell).__module__.startswith("circuits.")
    if not (included and mixture.transfer in TRANSFERS):
        return _fit(mixture)  # the source of another type or transfer may have changed
    key = f"population {mixture} numpy {np.__version__} scipy {scipy.__version__}"
    return cached("tables", SOURCES, key).once(lambda: _fit(mixture))


def _fit(mixture: Mixture) -> Arrays:
    """Fit the filters of rate and noise at some inputs.

    ``ends`` are the fields ``lowest``, ``highest`` and ``top`` of ``Answers``; ``hz`` and ``paces``
    (STATES,) the rates there and the positions between which coefficients are interpolated; then
    coefficients and misfits of both filters, empty without lags or noise.
    """
    rate = mixture.rate_hz
    low, high = _ends(rate, MOST_HZ)
    _, top = _ends(rate, min(TOP_HZ, OF_LIMIT * float(rate(np.array([FAR_NATS]))[0])))
    steps = np.linspace(low, high, STEPS)
    pace = _pace(rate(steps))
    paces = np.linspace(pace[0], pace[-1], STATES)
    x = np.interp(paces, pace, steps)
    hz = np.maximum(rate(x), LEAST_HZ)
    response = mixture.response(x, filters.FREQUENCIES_HZ)
    following = colour = filters.FittedFilter(np.zeros((0, 0)), np.zeros(0))
    if np.iscomplexobj(response.gain):
        following = filters.following(response.gain)
    if response.spectrum.max() > 0:
        # Near saturation the theoretical power is a difference of two nearly equal terms.
        power = np.maximum(np.nan_to_num(response.spectrum / hz[:, None], nan=1.0), LEAST_POWER)
        colour = filters.colour(power, hz)
    return {
        "ends": np.array([low, high, top]),
        "hz": hz,
        "paces": paces,
        "following": following.coefficients,
        "following_misfit": following.misfit,
        "colour": colour.coefficients,
        "colour_misfit": colour.misfit,
    }


@lru_cache(maxsize=64)
def looked_up(name: str) -> tuple[float, float, Array]:
    """Return the lowest and highest input of a transfer's table, and its values (POINTS,)."""
    law, ends = transfer.named(name), (-FAR_NATS / 4, FAR_NATS / 4)
    grid = np.linspace(*ends, POINTS)
    values, middles = law(grid), law((grid[1:] + grid[:-1]) / 2)
    off = np.abs((values[1:] + values[:-1]) / 2 - middles).max()
    if not off <= BENT * np.abs(values).max():
        problem = f"the population engine looks {name!r} up between points"
        raise ValueError(f"{problem}, and it is too curved for that")
    return *ends, values


def _ends(rate: Callable[[Array], Array], most_hz: float) -> tuple[float, float]:
    """Return the inputs at which the rate is LEAST_HZ and ``most_hz``, as far as they exist."""
    from scipy.optimize import brentq

    def of(x: float) -> float:
        return float(rate(np.array([x]))[0])

    least, most = of(-FAR_NATS), of(FAR_NATS)
    high = most_hz if most > most_hz else most - SHARE * (most - least)
    low = LEAST_HZ if least < LEAST_HZ else least + SHARE * (high - least)
    if not low < high:
        return -1.0, 1.0
    at = [brentq(lambda x, hz=hz: of(x) - hz, -FAR_NATS, FAR_NATS, xtol=1e-6) for hz in (low, high)]
    return float(at[0]), float(at[1])


def _pace(hz: Array) -> Array:
    """Return the logarithm of the rate, at least ``SLOWEST_HZ`` and made to rise strictly."""
    rising = np.log(np.maximum.accumulate(np.maximum(hz, SLOWEST_HZ)))
    return np.asarray(rising + 1e-9 * np.arange(len(hz)))


def _rough(cell: Cell, what: str, hz: Array, misfit: npt.NDArray[np.floating]) -> str:
    """Return a warning if a filter deviates too much, otherwise ""."""
    seen = (misfit > ROUGH) & (hz >= SEEN_HZ[0]) & (hz <= SEEN_HZ[1])
    if not seen.any():
        return ""
    worst = int(np.argmax(np.where(seen, misfit, 0)))
    return (
        f"{cell}: the population engine reproduces {what} at {hz[worst]:.0f} Hz only to within "
        f"{misfit[worst]:.0%}: check the results with a spiking engine"
    )
