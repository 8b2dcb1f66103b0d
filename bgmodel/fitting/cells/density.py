"""The exact density of a session's spikes and choices under a noisy sum of clicks.

The cells' sum z(t) = m(t) + n(t) has a part m that follows from the clicks and a noise n, an
Ornstein-Uhlenbeck process that is the same for all clicks. Given z, spikes are Poisson. The choice
is the sign of a second sum of the same clicks at the end of the trial, T, with another leak and
noise: x(T) = m_x(T) + r sqrt(V_x(T) / V_z(T)) n(T) + sqrt(1 - r^2) times independent noise of
variance V_x(T), where V_z and V_x are the variances of the noise of the sums, and r is their
correlation. With equal parameters and r = 1 both sums are one; with r = 0 spikes and choice are
independent given the clicks. What the deciding sum adds to n(T) does not depend on earlier n.

The density of a trial is the mean of p(choice | x) prod p(spikes | z) over paths of n: n is
one-dimensional, so that a sum over a grid (the forward algorithm) gives it without an error of
simulation. Its derivatives are means over the paths given the data (Fisher's identity), from the
forward and the backward pass.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import ndtr

from bgmodel.fitting.cells.encoding import Encoding
from bgmodel.fitting.cells.sessions import BIN_S, RecordedSession
from circuits.arrays import Array

FEWEST, MOST, WIDTH_SD = 40, 160, 4.5
"""Least and largest number of values of the noise, and their range in standard deviations."""
SPACING = 1.2
"""Largest distance of values in standard deviations of a step of the noise."""
STEP = 1e-4
"""Step of derivatives, as a share of a parameter."""
SUMS = ("leak_per_s", "adaptation", "recovery_s")
"""Parameters that move the sum of clicks."""
DECIDING = ("deciding_leak_per_s", *SUMS[1:])
"""Those of the sum that decides."""
Values = Mapping[str, float]


@dataclass(frozen=True)
class Passed:
    """The result of a forward and a backward pass: per trial."""

    log_density: Array  # (trials,), nats
    shared: dict[str, Array]  # derivatives by shared parameters, (trials,)
    cells: list[Array]  # by each cell's course, past and gain, (trials, numbers)


def moved(leak_per_s: float, noise: float, time_s: Array | float) -> tuple[Array, Array]:
    """Return the share of the noise that is left after a time, and the variance that is added."""
    time_s = np.asarray(time_s, float)
    left = np.exp(-leak_per_s * time_s)
    if abs(leak_per_s) < 1e-6:
        return left, noise**2 * time_s
    return left, noise**2 * -np.expm1(-2 * leak_per_s * time_s) / (2 * leak_per_s)


def variance(values: Values, time_s: Array | float, sum_of: str = "") -> Array:
    """Return the variance of the noise of the cells' sum, or of the sum that decides, at a time."""
    left, added = moved(values[f"{sum_of}leak_per_s"], values[f"{sum_of}noise"], time_s)
    return np.asarray(left**2 * values[f"{sum_of}start_noise"] ** 2 + added)


def p_right(
    session: RecordedSession, values: Values, n: Array | None = None, rest_s: Array | None = None
) -> Array:
    """Return the probability of response 1 without regard to spikes, in closed form, (trials,).

    With the cells' noise n (trials, ..., values) at a time ``rest_s`` (trials, ...) before the end,
    it is the probability given that noise, with the shape of n.
    """
    mean = session.sums(*(values[name] for name in DECIDING))[:, -1] + values["bias"]
    var = variance(values, session.end_s, "deciding_")
    if n is not None and rest_s is not None:
        left, added = moved(values["leak_per_s"], values["noise"], rest_s)
        per_trial = (-1, *[1] * (rest_s.ndim - 1))
        share = values["shared_noise"] * np.sqrt(var / variance(values, session.end_s))
        share, var, mean = (each.reshape(per_trial) for each in (share, var, mean))
        mean = mean[..., None] + (share * left)[..., None] * n
        var = (share**2 * added + (1 - values["shared_noise"] ** 2) * var)[..., None]
    right = ndtr(mean / np.sqrt(var + values["choice_noise"] ** 2))
    return np.asarray((1 - values["lapse"]) * right + values["lapse"] / 2)


def chosen(p: Array, session: RecordedSession) -> Array:
    """Return the probability of each choice, from that of response 1; 1 without a choice."""
    choice = session.choice.reshape(-1, *[1] * (p.ndim - 1))
    return np.where(choice < 0, 1.0, np.where(choice == 1, p, 1 - p))


def noise_grid(session: RecordedSession, values: Values) -> Array:
    """Return values of the noise that cover its range with enough resolution."""
    left, added = moved(values["leak_per_s"], values["noise"], session.end_s.max())
    start = values["start_noise"] ** 2
    sd = float(np.sqrt(np.maximum(start, left**2 * start + added)))
    step = np.sqrt(moved(values["leak_per_s"], values["noise"], BIN_S)[1])
    count = np.clip(np.ceil(2 * WIDTH_SD * sd / (SPACING * step)), FEWEST, MOST)
    return np.asarray(np.linspace(-WIDTH_SD * sd, WIDTH_SD * sd, int(count)))


def _pieces(session: RecordedSession, values: Values, n: Array) -> tuple[Array, Array, Array]:
    """Return the distribution of the first noise, transitions, and p(choice) by trial and noise."""
    leak, noise = values["leak_per_s"], values["noise"]
    first = np.exp(-(n**2) / 2 / variance(values, BIN_S / 2))
    left, added = moved(leak, noise, BIN_S)
    # Where a step adds little noise, it is as wide as the grid resolves.
    wide = np.maximum(added, (0.35 * (n[1] - n[0])) ** 2)
    steps = np.exp(-((n - left * n[:, None]) ** 2) / 2 / wide)
    rest_s = np.maximum(session.end_s - session.middles_s[session.bins - 1], 0.0)
    right = p_right(session, values, n[None], rest_s)
    return first / first.sum(), steps / steps.sum(axis=1, keepdims=True), chosen(right, session)


def encoded_by(encoding: Encoding, values: Values, x: Array) -> tuple[Array, Array, Array | float]:
    """Return ``Encoding.encode`` of a sum of clicks in the middle of a bin, averaged over the bin.

    The noise moves by noise^2 |t| in a time t, a quarter of noise^2 BIN_S on average.
    """
    scale = values.get("nats_per_click", 1.0)
    return encoding.encode(scale * x, scale * values["noise"] * np.sqrt(BIN_S) / 2)


@dataclass(frozen=True)
class _Forward:
    """The forward pass over a session."""

    n: Array  # (values,), noise
    sums: Array  # (trials, bins + 1)
    steps: Array  # (values, values), transitions
    choice: Array  # (trials, values)
    spikes: Array  # (trials, bins, values), probability of spikes up to a factor
    ahead: Array  # (trials, bins, values), noise given the spikes so far
    size: Array  # (trials, bins), probability of a bin's spikes given those before
    end: Array  # (trials,), probability of the choice given all spikes


def passed(
    session: RecordedSession, values: Values, cells: Sequence[Array], encoding: Encoding,
    free: Sequence[str] | None = None,
) -> Passed:  # fmt: skip
    """Return the log density of each trial and, with names of shared parameters, its derivatives.

    Each cell is (course, ..., past, gain), see ``RecordedSession``. Without ``free`` there is no
    backward pass.
    """
    n, on = noise_grid(session, values), session.on
    bins, scale = session.counts.shape[2], values.get("nats_per_click", 1.0)
    sums = session.sums(*(values[name] for name in SUMS))
    first, steps, choice = _pieces(session, values, n)
    # Spikes by bins that belong to a trial, (these bins, values).
    x = sums[:, :bins][on][:, None] + n
    read, slope, bend = encoded_by(encoding, values, x)
    log_spikes, pulls = np.zeros(x.shape), []
    for count, past, cell in zip(session.counts, session.past, cells, strict=True):
        base, count = (session.basis @ cell[:-2] + cell[-2] * past)[on], count[on][:, None]
        log, rate, rise = encoding.rate(base[:, None], cell[-1] * read)
        rate *= BIN_S
        log_spikes += count * log - rate
        if free is not None:
            pulls.append((count - rate, rise))
    log_spikes += np.log(BIN_S) * session.counts.sum(axis=0)[on][:, None]
    top, spikes = np.zeros(on.shape), np.ones((*on.shape, len(n)))
    top[on] = log_spikes.max(axis=1)
    spikes[on] = np.exp(log_spikes - top[on][:, None])
    ahead, size = np.empty(spikes.shape), np.ones(on.shape)
    for k in range(bins):
        now = np.where(on[:, k, None], ahead[:, k - 1] @ steps, ahead[:, k - 1]) if k else first
        now = now * spikes[:, k]
        size[:, k] = now.sum(axis=1)
        ahead[:, k] = now / size[:, k, None]
    end = (ahead[:, -1] * choice).sum(axis=1)
    log_density = top.sum(axis=1) + np.log(size).sum(axis=1) + np.log(end)
    if free is None:
        return Passed(log_density, {}, [])
    forward = _Forward(n, sums, steps, choice, spikes, ahead, size, end)
    behind, weighted = _backward(session, forward)
    paths = ahead[on] * behind[on]
    by_sum, of_cells = np.zeros(sums.shape), []
    by_scale, by_spread = np.zeros(on.shape), np.zeros(on.shape)
    for (pull, rise), past, cell in zip(pulls, session.past, cells, strict=True):
        pull *= paths
        base, gain = np.zeros(on.shape), np.zeros(on.shape)
        base[on] = pull.sum(axis=1)
        pull *= rise
        gain[on] = (pull * read).sum(axis=1)
        derivatives = [base @ session.basis, (base * past).sum(axis=1), gain.sum(axis=1)]
        of_cells.append(np.column_stack(derivatives))
        if encoding.curve is not None:
            by_spread[on] += (pull * (cell[-1] * bend)).sum(axis=1)
        pull *= cell[-1] * slope
        by_sum[:, :bins][on] += scale * pull.sum(axis=1)
        by_scale[on] += (pull * x).sum(axis=1)
    shared = {
        name: by_scale.sum(axis=1) if name == "nats_per_click"
        else _by_shared(session, values, name, forward, behind, weighted, by_sum)
        for name in free
    }  # fmt: skip
    if encoding.curve is not None:
        # Half the squared spread is scale^2 noise^2 BIN_S / 8.
        by_squared = by_spread.sum(axis=1) * (scale * values["noise"]) ** 2 * BIN_S / 4
        for name in {"nats_per_click", "noise"} & set(free):
            shared[name] += by_squared / values[name]
    return Passed(log_density, shared, of_cells)


def _backward(session: RecordedSession, forward: _Forward) -> tuple[Array, Array]:
    """Return the backward pass: later data given the noise of each bin, and scaled spikes."""
    weighted = forward.spikes / forward.size[:, :, None]
    behind = np.empty(weighted.shape)
    behind[:, -1] = forward.choice / forward.end[:, None]
    for k in range(session.counts.shape[2] - 1, 0, -1):
        back = (behind[:, k] * weighted[:, k]) @ forward.steps.T
        behind[:, k - 1] = np.where(session.on[:, k, None], back, behind[:, k])
    return behind, weighted


def _by_shared(
    session: RecordedSession, values: Values, name: str, forward: _Forward, behind: Array,
    weighted: Array, by_sum: Array,
) -> Array:  # fmt: skip
    """Return the derivative of each trial's log density by a parameter of the sum or the choice."""
    step = STEP * max(abs(values[name]), 0.1)

    def pieces(away: float) -> list[Array]:
        there = {**values, name: values[name] + away}
        sums = session.sums(*(there[each] for each in SUMS)) if name in SUMS else forward.sums
        return [*_pieces(session, there, forward.n), sums]

    both = zip(pieces(step), pieces(-step), strict=True)
    first, steps, choice, sums = ((above - below) / (2 * step) for above, below in both)
    derivative: Array = (first * weighted[:, 0] * behind[:, 0]).sum(axis=1)
    if steps.any():
        for k in range(1, behind.shape[1]):
            moved_to = (forward.ahead[:, k - 1] @ steps) * weighted[:, k] * behind[:, k]
            derivative += session.on[:, k] * moved_to.sum(axis=1)
    derivative += (forward.ahead[:, -1] * choice).sum(axis=1) / forward.end
    return np.asarray(derivative + (sums * by_sum).sum(axis=1))
