"""Checks of a whole table of choices: errors if it is wrong, warnings if it is doubtful."""

from __future__ import annotations

import re
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
import pandas as pd

from bgmodel.trials.columns import FEWEST, NO_RESPONSE, OURS
from circuits.arrays import Array, Truths
from circuits.errors import DataWarning, InputError

LATE, TOO_LATE = 3.0, 10.0
"""Multiples of the slowest response from which a deadline gives a warning, and an error."""
LONG_MEDIAN_S, SHORT_MEDIAN_S = 5.0, 0.1
"""Range of median response times, s, outside which a warning is given."""
STEPS_S = (0.5, 0.25, 0.2, 0.1, 0.05, 0.04, 1 / 30, 0.025, 0.02)
"""Coarsest resolutions to test, s; finer ones shift no estimate by half a standard error."""
STEP_ERROR_S = 6e-4
"""Tolerance within which a time counts as a multiple of a step."""
LEAST_RIGHT, ENOUGH = 0.6, 20
"""Proportion correct at the largest strength below which signs are taken to be missing, and the
number of responses required."""
STRENGTHS = ("coherence", "coh", "contrast", "strength", "evidence", "stimulus")
"""Words in the names of columns that may hold the strength of evidence."""
CORRELATED, ERRORS_OF_R = 0.15, 5.0
"""Correlation with responses, and its z score, above which a column may be the strength."""
PILE, PILE_SHARE = 5, 0.01
"""Number and share of times exactly equal to the longest, above which trials were probably cut off
there; the number is also compared with the average number of trials per distinct time."""
APART, APART_SHARE = 20.0, 0.05
"""Ratio of successive times, and share of trials on either side of it, from which times can't all
be response times in one unit: not even times with many slow trials have such a gap."""
FAST_S, FAST_SHARE = 0.1, 0.01
"""Times below which responses are anticipations, s, and the share of them that gives a warning."""
MIXED = 100.0
"""Ratio of the median times of two participants above which their units may differ."""
CODES = (99.0, 999.0, 9999.0)
"""Usual codes of missing values."""
FAR = 10.0
"""Ratio of strengths above which the larger one is doubtful if few trials have it."""
COPIED, NEAR_S = 0.01, 0.1
"""Share of duplicate rows from which a warning is given, and distance of times that are compared
with equal ones."""
SAME = 1e-6
"""Relative difference below which two strengths differ only by rounding."""
FASTEST, FEWEST_TIMES, DISTINCT, ABRUPT, ABRUPT_ERRORS = 10, 80, 6, 0.35, 3.0
"""The fastest are one in ten of a person's times, at least ten; fewest times, and fewest of the
fastest that differ. Then the share of these in the lower half of their range: a half if faster ones
were left out, 0.04 to 0.33 in the included sets and 0.21 to 0.32 in 40 simulated ones; and by how
many standard errors it is higher. Without a tenth of each person's trials it is 6 to 8."""

NUMBERS = ("trial", "trial_number", "trial_index")
"""Columns of numbers that trials have in the order of presentation."""
DELAYS = ("ssd", "stop_signal_delay", "stopsignaldelay")
"""Names of a column of stop-signal delays, without capitals."""
STOPS = "Columns(ssd=...), at the terminal --columns ssd="


def check_no_stops(table: pd.DataFrame) -> None:
    """Refuse tables with stop trials: their missing responses are not slow choices."""
    for name in table:
        delays = str(name).lower() in DELAYS and pd.to_numeric(table[name], errors="coerce")
        if delays is not False and (stops := int(delays.notna().sum())):
            raise InputError(
                f"column {str(name)!r} has the stop-signal delays of {stops} trials, which are no "
                f"choices: name the column to read them as such ({STOPS}), or leave these trials "
                "out",
                name,
            )


def check_times(rt_s: Array) -> None:
    """Refuse times (trials,) not in s; warn of doubtful units, rounding and anticipations."""
    timed = rt_s[np.isfinite(rt_s)]
    if len(timed) < FEWEST:
        return
    check_one_unit(timed)
    median = float(np.median(timed))
    integral = bool((timed == np.round(timed)).all())
    if median > LONG_MEDIAN_S and integral:
        raise InputError(
            f"rt must be in seconds, got {len(timed)} whole numbers with a median of {median:g} "
            "s: divide by 100 if these are hundredths of a second",
            "rt",
        )
    if not SHORT_MEDIAN_S <= median <= LONG_MEDIAN_S:
        DataWarning.warn(
            f"the median of rt is {median:.3g} s: check that rt is in seconds from the onset of "
            "evidence (hundredths of a second have to be divided by 100)"
        )
    for step_s in STEPS_S:
        if (np.abs(timed - step_s * np.round(timed / step_s)) <= STEP_ERROR_S).all():
            DataWarning.warn(
                f"all {len(timed)} times are multiples of {step_s:.3g} s: rounding adds "
                f"{1000 * step_s / np.sqrt(12):.0f} ms to t0_sd_s, and truncation also subtracts "
                f"{500 * step_s:.0f} ms from t0_s"
            )
            break
    _warn_of_pile(timed)
    fast = int((timed < FAST_S).sum())
    if median >= SHORT_MEDIAN_S and fast >= max(PILE, FAST_SHARE * len(timed)):
        DataWarning.warn(
            f"{fast} of {len(timed)} times are below {FAST_S:g} s, the shortest {timed.min():.3g} "
            "s: responses to the evidence take longer. Leave such trials out, or begin the window "
            "of a fit later (rt_window, at the terminal --columns rt_window=)"
        )


def check_one_unit(rt_s: Array) -> None:
    """Raise ValueError if times fall into two groups, a factor of 20 or more apart."""
    times = np.sort(rt_s[np.isfinite(rt_s)])
    if len(times) < FEWEST:
        return
    ratio = times[1:] / times[:-1]
    below = int(np.argmax(ratio)) + 1
    above = len(times) - below
    if ratio.max() >= APART and min(above, below) >= max(FEWEST, APART_SHARE * len(times)):
        raise InputError(
            f"rt must be in seconds in every trial, got {below} times up to {times[below - 1]:.3g} "
            f"s and {above} of {times[below]:.3g} s and more, and none between: if one group is in "
            "another unit, convert it; if it is a code, such as one of missing responses, leave rt "
            "and response empty",
            "rt",
        )


def _warn_of_pile(rt_s: Array) -> None:
    longest = float(rt_s.max())
    ends, times = int((rt_s == longest).sum()), len(np.unique(rt_s))
    # With coarse times, many trials share each value.
    if ends >= PILE and ends > PILE_SHARE * len(rt_s) and ends > PILE * len(rt_s) / times:
        DataWarning.warn(
            f"{ends} of {len(rt_s)} times are exactly the longest one, {longest:g} s: if trials "
            "ended then without a response, leave rt and response empty, and give that time "
            "as the deadline (deadline_s, at the terminal --columns deadline_s=)"
        )


def warn_of_far(strength: Array) -> None:
    """Warn if a few signed strengths, or codes of missing values, are far beyond all others."""
    sizes, counts = np.unique(np.abs(strength), return_counts=True)
    above = sizes[1:] >= FAR * sizes[:-1]
    for first in np.flatnonzero(above & (sizes[:-1] > 0)) + 1:
        many = int(counts[first:].sum())
        if many < FEWEST or sizes[first] in CODES:
            DataWarning.warn(
                f"{many} of {len(strength)} trials have a strength of {sizes[first]:g} or more, "
                f"and all others of {sizes[first - 1]:g} or less: check them, since few such "
                "trials set the sensitivity of all"
            )
            break


def warn_of_units(strength: Array) -> None:
    """Warn if some signed strengths seem to be in per cent and others in shares."""
    sizes, counts = np.unique(np.abs(strength[strength != 0]), return_counts=True)
    larger = np.array([np.isclose(sizes, 100 * size, rtol=SAME, atol=0) for size in sizes])
    pairs = int(larger.sum())
    if pairs >= 2 and 2 * pairs >= len(sizes):
        many = int(counts[larger.any(axis=0)].sum())
        first = sizes[larger.any(axis=1)][0]
        DataWarning.warn(
            f"{pairs} of {len(sizes)} strengths also occur a hundred times as large, such as "
            f"{first:g} and {100 * first:g}: if the larger ones, in {many} of {len(strength)} "
            "trials, are in per cent, divide them by 100"
        )


def warn_of_mixed_units(rt_s: Array, participant: npt.NDArray[np.str_]) -> None:
    """Warn if median times of participants differ as ms and s do."""
    medians = pd.Series(rt_s).groupby(participant).median().dropna()
    if len(medians) > 1 and medians.max() > MIXED * medians.min():
        DataWarning.warn(
            f"median times of participants run from {medians.min():.3g} s ({medians.idxmin()}) to "
            f"{medians.max():.3g} s ({medians.idxmax()}): are all of them in seconds?"
        )


def warn_of_copies(table: pd.DataFrame, used: Sequence[str]) -> None:
    """Warn of more duplicate trials than by chance: standard errors would be too small.

    How often close times are equal by chance is estimated from rows that differ elsewhere.
    """
    table = table[[name for name in (*OURS, *used) if name in table]]
    copies = int(table.duplicated().sum())
    if copies < max(FEWEST, COPIED * len(table)):
        return
    alike, chance = _alike(table)
    if alike > 1.25 * chance + 5 * np.sqrt(chance) + 5:
        columns = ", ".join(map(str, table))
        DataWarning.warn(
            f"{copies} of {len(table)} rows are duplicates of earlier ones: {alike:.0f} pairs of "
            f"rows are equal in {columns}; about {chance:.0f} are expected by chance. If "
            "trials were concatenated twice, or a merge repeated them, remove the duplicates: "
            "standard errors count each row as an independent trial"
        )


def _alike(table: pd.DataFrame) -> tuple[float, float]:
    """Return the number of pairs of equal rows, and the number expected by chance."""
    times = pd.to_numeric(table["rt"], errors="coerce")
    table = table.assign(rt=times)[times > 0]  # trials without a response cannot be distinguished
    rest = [name for name in table if name != "rt"]
    who = ["participant_id"] if "participant_id" in rest else []
    alike = chance = 0.0
    for _, mine in table.groupby(who, sort=False) if who else [((), table)]:
        same = mine[mine.duplicated(rest, keep=False)]
        groups = same.groupby(rest, sort=False, dropna=False)["rt"]
        within = sum((_pairs(group.to_numpy()) for _, group in groups), np.zeros(2))
        equal, near = _pairs(mine["rt"].to_numpy()) - within
        alike += float(within[0])
        chance += float(within[1] * equal / near) if near else 0.0
    return alike, chance


def _pairs(rt_s: Array) -> Array:
    rt_s = np.sort(rt_s)
    places = np.arange(len(rt_s)) + 1
    ends = [np.searchsorted(rt_s, rt_s + width, side="right") for width in (0.0, NEAR_S)]
    return np.array([(end - places).sum() for end in ends], dtype=float)


def warn_of_twins(
    participant: npt.NDArray[np.str_], rt_s: Array, response: npt.NDArray[np.int8]
) -> None:
    """Warn if two participants have the same trials: one of them under two names."""
    seen: dict[bytes, str] = {}
    twins = []
    for who in np.unique(participant).tolist():
        times, codes = rt_s[participant == who], response[participant == who]
        if len(np.unique(times[np.isfinite(times)])) < FEWEST:
            continue
        order = np.lexsort((codes, times))
        first = seen.setdefault(times[order].tobytes() + codes[order].tobytes(), who)
        if first != who:
            twins.append(f"{first!r} and {who!r}")
    if twins:
        DataWarning.warn(
            f"participants {'; '.join(twins[:3])} have exactly the same times and responses: if "
            "they are one person under two names, keep one of them"
        )


def fastest(rt_s: Array) -> tuple[Array, Truths]:
    """Return the fastest tenth of times, and which between its ends are below its middle."""
    fast = np.sort(rt_s[np.isfinite(rt_s)])
    fast = fast[: max(len(fast) // FASTEST, FASTEST)]
    return fast, fast[1:-1] <= (fast[0] + fast[-1]) / 2


def warn_of_abrupt(rt_s: Array, participant: npt.NDArray[np.str_]) -> None:
    """Warn if the times of all participants begin as if faster trials had been left out."""
    lower = fast = 0
    for who in np.unique(participant):
        times_s = rt_s[(participant == who) & np.isfinite(rt_s)]
        if len(times_s) < FEWEST_TIMES:
            continue
        first, below = fastest(times_s)
        if len(np.unique(first)) >= DISTINCT:
            lower += int(below.sum())
            fast += len(below)
    if lower > ABRUPT * fast + ABRUPT_ERRORS * np.sqrt(ABRUPT * (1 - ABRUPT) * fast):
        DataWarning.warn(
            f"response times begin abruptly: of the {fast} fastest, one in {FASTEST} of each "
            f"participant's, {lower / fast:.0%} are in the lower half of their range, where half "
            f"are if faster trials were left out and fewer than {ABRUPT:.0%} if not. If they "
            "were, restore them: fits assume that all trials are there"
        )


def warn_of_order(table: pd.DataFrame, *groups: npt.NDArray[np.str_]) -> None:
    """Warn if numbers of trials fall within groups (rows,): what is learned depends on the order.

    Numbers that start anew, as in each block, may fall in a quarter of trials.
    """
    for name in (name for name in NUMBERS if name in table):
        numbers = pd.to_numeric(table[name], errors="coerce").reset_index(drop=True)
        for _, mine in numbers.groupby(list(groups)):
            falls = int((mine.diff() < 0).sum())
            if falls > (0 if mine.is_unique else len(mine) / 4):
                DataWarning.warn(
                    f"rows must be in the order of presentation, since a trial depends on earlier "
                    f"ones, yet {name} falls {falls} times in {len(mine)} rows, first to "
                    f"{mine[mine.diff() < 0].iloc[0]:g}: sort them"
                )
                return


def check_deadline(rt_s: Array, deadline_s: float) -> None:
    """Refuse a deadline from 10 times the slowest response on, and warn of one from 3 times on."""
    known_s = rt_s[np.isfinite(rt_s)]
    if not len(known_s) or deadline_s < LATE * known_s.max():
        return
    missed, slowest = len(rt_s) - len(known_s), float(known_s.max())
    if deadline_s >= TOO_LATE * slowest:
        raise InputError(
            f"deadline_s must be the time at which trials ended, s, got {deadline_s:g}, while the "
            f"slowest of {len(known_s)} responses took {slowest:.3g} s: divide by 1000 if it is in "
            "milliseconds, or leave out trials without a response that did not end by a deadline",
            "deadline_s",
        )
    advice = (
        f"{missed} trials without a response are hardly slow decisions. Check the deadline, or "
        "leave these trials out"
        if missed
        else "leave it out, since every trial has a response"
    )
    DataWarning.warn(
        f"the slowest of {len(known_s)} responses took {slowest:.3g} s, and deadline_s is "
        f"{deadline_s:g}: {advice}"
    )


def check_signs(strength: Array | None, response: npt.NDArray[np.int8]) -> None:
    """Raise ValueError if no strength is negative, yet many responses to the largest are 0."""
    if strength is None or (strength < 0).any() or not strength.any():
        return
    most = (response >= 0) & (np.abs(strength) == np.abs(strength).max())
    wrong = int((response[most] == 0).sum())
    if most.sum() >= ENOUGH and wrong > (1 - LEAST_RIGHT) * most.sum():
        raise InputError(
            f"strength must be signed, positive where it favours response 1: none is below "
            f"0, yet {wrong} of {int(most.sum())} responses to the largest are 0. For unsigned "
            "strengths, name the column that is 1 for correct responses and 0 for errors "
            "(response, at the terminal --columns response=), or the column of the correct "
            "response (stimulus, --columns stimulus=)",
            "strength",
        )


def warn_without_strength(
    table: pd.DataFrame,
    used: Sequence[str],
    response: npt.NDArray[np.int8],
    alternatives: int = 2,
) -> None:
    """Warn if a column may hold the strength, or else if response 1 may not be correct."""
    candidates = []
    for name in table:
        if name in (*OURS, *NUMBERS, *used):
            continue
        values = pd.to_numeric(table[name], errors="coerce").to_numpy(dtype=float, na_value=np.nan)
        distinct = len(np.unique(values)) if np.isfinite(values).all() else 0
        if distinct < 2:
            continue
        r = _correlation(values, response) if distinct > 2 else 0.0
        called = any(word in STRENGTHS for word in re.split(r"[^a-z]+", str(name).lower()))
        if called or abs(r) > max(CORRELATED, ERRORS_OF_R / np.sqrt(len(values))):
            candidates.append(f"{name} ({distinct} values, correlation with response 1 {r:.2f})")
    if candidates:
        DataWarning.warn(
            f"no strength is named, and {', '.join(candidates)} may hold it: without strength all "
            "trials count as equally difficult. Name the column of signed strengths (strength, at "
            "the terminal --strength)"
        )
        return
    if alternatives > 2:
        return
    share = float((response[response >= 0] == 1).mean())
    if share < LEAST_RIGHT:
        DataWarning.warn(
            f"no strength is given, so response 1 is taken as correct, and it is "
            f"{share:.0%} of responses: name the column of signed strengths (strength, at the "
            "terminal --strength)"
        )


def _correlation(values: Array, response: npt.NDArray[np.int8]) -> float:
    answered = response != NO_RESPONSE
    x, y = values[answered], response[answered].astype(float)
    return float(np.corrcoef(x, y)[0, 1]) if np.ptp(x) > 0 and np.ptp(y) > 0 else 0.0


def without_rounding(strength: Array) -> Array:
    """Merge signed strengths whose sizes differ by less than a millionth; warn if there are any."""
    sizes, counts = np.unique(np.abs(strength), return_counts=True)
    group = np.concatenate([[0], np.cumsum(np.diff(sizes) > SAME * sizes[1:])])
    if len(sizes) == group[-1] + 1:
        return strength
    # Each group is represented by its most frequent value.
    merged = sizes.copy()
    for each in np.flatnonzero(np.bincount(group) > 1):
        some = group == each
        merged[some] = sizes[some][np.argmax(counts[some])]
    first = int(np.flatnonzero(merged != sizes)[0])
    DataWarning.warn(
        f"{len(sizes)} strengths are merged to {group[-1] + 1}, since some differ only by "
        f"rounding, such as {sizes[first]!r:.22} and {merged[first]!r:.22}"
    )
    at = np.searchsorted(sizes, np.abs(strength))
    return np.asarray(np.sign(strength) * merged[at])
