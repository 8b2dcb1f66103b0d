"""Stop-signal delays that a program did not record, restored from its staircases.

Some programs give no stop signal if the response comes first, and then record a delay of 0. Left at
0, such trials look like failures to stop at the shortest delay, raise estimates of the stop-signal
reaction time, and imitate violations of the race model. If all other delays follow one-up-one-down
staircases, the missing ones can be inferred from the delays that come before and after.

In the shipped set, 268 of 274 trials with a delay of exactly 0 have a response, from participants
whose staircases are near 300 ms. The other 6 belong to a participant who never responds.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from bgmodel.support.arrays import Array, Integers, Truths
from bgmodel.trials.record import Trials
from circuits.errors import DataWarning, InputError, require

STEP_MS = 50.0
"""Step of the staircases of the shipped set."""
LATE_MS = 10.0
"""A missing delay may lie this far before the response, because screens and keys have delays."""


def restored_delays(trials: Trials, step_ms: float = STEP_MS, *, use_times: bool = True) -> Trials:
    """Return trials in which delays recorded as 0 are those of the participant's staircases.

    Two interleaved staircases are assumed, each one step up after a successful stop and one down
    after a failed one; which staircase a trial belongs to, and where each started, is inferred. The
    path with the fewest contradictions is found by dynamic programming (Viterbi): a contradiction
    is a recorded delay that neither staircase has, or (with ``use_times``) a restored delay before
    the response; more than a tenth of a participant's are warned of. Without ``use_times``,
    response times are a test of the restored delays. Only responses on stop trials with a delay of
    exactly 0 are restored.
    """
    require(step_ms > 0, "step_ms", "must be > 0", step_ms)
    if trials.ssd_s is None:
        raise InputError("must have stop-signal delays", "ssd")
    ssd_s, rt_ms = trials.ssd_s.copy(), 1000 * trials.rt_s
    for who in trials.people():
        stops = np.flatnonzero((trials.participant == who) & ~np.isnan(ssd_s))
        missing = (ssd_s[stops] == 0) & ~np.isnan(rt_ms[stops])
        if not missing.any():
            continue
        path, contradictions = _path(1000 * ssd_s[stops], rt_ms[stops], missing, step_ms, use_times)
        if contradictions > len(stops) / 10:
            DataWarning.warn(
                f"{contradictions:.0f} of {len(stops)} stop trials of {who} contradict two "
                f"staircases with steps of {step_ms:g} ms: their restored delays are doubtful"
            )
        ssd_s[stops[missing]] = path[missing] * step_ms / 1000
    return replace(trials, ssd_s=ssd_s)


def _path(
    ssd: Array, rt: Array, missing: Truths, step_ms: float, use_times: bool
) -> tuple[Integers, float]:
    """Return the step of the staircase that each stop trial belongs to, and the contradictions.

    A state is the current step of each staircase. Each trial takes its delay from one staircase and
    moves it. The smallest number of contradictions from a state to the end is computed backwards in
    time; the best path is then followed forwards.
    """
    levels = int(np.ceil(ssd.max() / step_ms)) + 4
    steps = np.arange(levels)
    after = np.clip(steps + np.where(np.isnan(rt), 1, -1)[:, None], 0, levels - 1)
    wrong = np.abs(ssd[:, None] - steps * step_ms) > step_ms / 2
    early = use_times & (steps * step_ms + LATE_MS < rt[:, None])
    cost = np.where(missing[:, None], early, wrong).astype(float)
    to_come, first = np.zeros((levels, levels)), np.zeros((len(ssd), levels, levels), bool)
    for k in range(len(ssd) - 1, -1, -1):
        one = cost[k][:, None] + to_come[after[k]]
        other = cost[k][None, :] + to_come[:, after[k]]
        first[k], to_come = one <= other, np.minimum(one, other)
    state = list(np.unravel_index(int(to_come.argmin()), to_come.shape))
    path = np.empty(len(ssd), dtype=np.int64)
    for k in range(len(ssd)):
        which = 0 if first[k][state[0], state[1]] else 1
        path[k] = state[which]
        state[which] = after[k][path[k]]
    return path, float(to_come.min())
