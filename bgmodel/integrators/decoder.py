"""A simple decoder of a circuit's input spikes: separates losses in the circuit from theirs."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from bgmodel.deciding.decision import UNDECIDED, first_crossing
from bgmodel.deciding.trace import Trace
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
    """Return ``decoded_input`` for trials that were dropped once the circuit had decided.

    Trials whose decoder has not crossed the lowest threshold yet are run again: ``again`` maps the
    number of a trial to its activity and OUT, run to the end.
    """
    trace_of_decoder = decoded_input(activity, trace, tau_ms)
    dropped = np.isnan(trace.out_nats[:, -1, 0])
    decision = first_crossing(trace_of_decoder, lowest, forced=False, checked=False)
    undecided = decision.choice == UNDECIDED
    for t in np.flatnonzero(dropped & undecided).tolist():
        trace_of_decoder.out_nats[t] = decoded_input(*again(t), tau_ms).out_nats[0]
    return trace_of_decoder


def decoded_input(activity: Activity, trace: Trace, tau_ms: float = 20.0) -> Trace:
    """Return -ln softmax of a circuit's input, decoded from its spikes by an exponential filter.

    Spikes are counted through one exponential filter; the rest of the computation is exact. A
    circuit's loss relative to this decoder therefore arises within the circuit. The decoder is no
    upper limit: another filter, or knowing when readings come, may do better. The result has the
    times of ``trace``, the circuit's OUT.
    """
    # Importing scipy.signal takes half a second: only when spikes are decoded.
    from scipy.signal import lfilter

    activity.circuit.check_nats("-ln softmax of its input")
    y = activity.decoded_nats(activity.circuit.input)
    keep = np.exp(-float(activity.time_ms[0]) / tau_ms)
    # Terms common to all channels cancel: at the start none is ahead.
    seen = lfilter([1 - keep], [1, -keep], y, axis=1)
    # A dropped trial has no further spikes.
    ended = np.isnan(y[:, :, 0])
    last = np.maximum((~ended).sum(axis=1) - 1, 0)
    seen = np.where(ended[:, :, None], seen[np.arange(len(y)), last][:, None], seen)
    return replace(trace, out_nats=minus_log_softmax(seen), readout=OF_MSPRT)
