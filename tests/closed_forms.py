"""Accuracy and times of a diffusion between two constant bounds, in closed form."""

import numpy as np


def accuracy(drift, bound):
    """Return the probability of the response favoured by the drift (Palmer, Huk & Shadlen 2005)."""
    odds = 2 * np.asarray(bound) * np.abs(drift)
    return 1 / (1 + np.exp(-odds))


def mean_time_s(drift, bound):
    """Return the mean decision time, s (Palmer, Huk & Shadlen 2005)."""
    v, a = np.broadcast_arrays(np.abs(np.asarray(drift, float)), np.asarray(bound, float))
    still = v * a < 1e-6
    safe = np.where(still, 1.0, v)
    return np.where(still, a**2, a / safe * np.tanh(a * safe))


def sd_time_s(drift, bound):
    """Return the standard deviation of decision times, s, from the cumulants of the time."""
    v, a = np.broadcast_arrays(np.abs(np.asarray(drift, float)), np.asarray(bound, float))
    x = np.maximum(a * v, 0.02)  # below it the following difference would be rounding error
    variance = a**4 * (np.tanh(x) / x**3 - 1 / (x * np.cosh(x)) ** 2)
    near = a**4 * (2 / 3 - 8 / 15 * (a * v) ** 2)
    return np.sqrt(np.where(a * v < 0.02, near, variance))
