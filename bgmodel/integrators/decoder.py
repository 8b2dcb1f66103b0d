"""What a plain decoder makes of the spikes that a circuit is given: what is lost behind them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from bgmodel.deciding.decision import UNDECIDED, Trace, first_crossing
from bgmodel.evidence import minus_log_softmax
from bgmodel.integrators.sprt import OF_MSPRT

if TYPE_CHECKING:
    from circuits.activity import Activity


def decoded(
    activity: Activity,
    trace: Trace,
    lowest: float,
    again: Callable[[int], tuple[Activity, Trace]],
    tau_ms: float,
) -> Trace:
    """Return ``decoded_input`` where trials were dropped once their circuit had decided.

    Parameters
    ----------
    activity, trace, tau_ms :
        As for ``decoded_input``.
    lowest : float
        Lowest threshold, nats. A trial whose decoder has not crossed it by then is run again.
    again : callable
        From the number of a trial to its activity and OUT, not dropped.
    """
    found = decoded_input(activity, trace, tau_ms)
    dropped = np.isnan(trace.out_nats[:, -1, 0])
    decision = first_crossing(found, lowest, forced=False, checked=False)
    undecided = decision.choice == UNDECIDED
    for t in np.flatnonzero(dropped & undecided).tolist():
        found.out_nats[t] = decoded_input(*again(t), tau_ms).out_nats[0]
    return found


def decoded_input(activity: Activity, trace: Trace, tau_ms: float = 20.0) -> Trace:
    """Return -ln softmax of a circuit's input, decoded from its spikes by a plain filter.

    It counts spikes through one exponential filter and knows the rest of the computation exactly:
    what a circuit behind these spikes loses against it is its own. It is no bound: another filter,
    or knowledge of when readings come, may do better.

    Parameters
    ----------
    activity : Activity
        Of an engine that spikes, with rates.
    trace : Trace
        The circuit's OUT in that activity; the result has its times.
    tau_ms : float
        Time constant with which it counts, ms.
    """
    # Importing scipy.signal takes half a second: only where spikes are decoded.
    from scipy.signal import lfilter

    activity.circuit.check_nats("-ln softmax of its input")
    y = activity.decoded_nats(activity.circuit.input)
    keep = np.exp(-float(activity.time_ms[0]) / tau_ms)
    # What all channels share changes nothing: at the start none is ahead.
    seen = lfilter([1 - keep], [1, -keep], y, axis=1)
    # After a trial was dropped nothing new comes.
    ended = np.isnan(y[:, :, 0])
    last = np.maximum((~ended).sum(axis=1) - 1, 0)
    seen = np.where(ended[:, :, None], seen[np.arange(len(y)), last][:, None], seen)
    return replace(trace, out_nats=minus_log_softmax(seen), readout=OF_MSPRT)
