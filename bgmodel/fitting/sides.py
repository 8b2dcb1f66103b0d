"""Checks of whether responses agree with the sign of strengths."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from bgmodel.deciding.calibration import STANDARD_ERRORS
from bgmodel.trials.cautions import check_signs
from bgmodel.trials.columns import EVERYONE
from bgmodel.trials.record import Trials
from circuits.errors import DataWarning, InputError

CHANCE, ENOUGH = 2.0, 50
"""Standard errors above chance up to which responses do not show that they follow the strength, and
the number of responses required."""
SAME = 0.6
"""If one response exceeds this share for both signs, it may be coded as correct or wrong."""


def name_of(choices: Trials) -> str:
    """Return the participant's name for messages, "all" if there are several."""
    people = choices.people()
    return people[0] if len(people) == 1 else EVERYONE


def check_sides(choices: Trials, by: Sequence[str] = (), *, biased: bool = False) -> None:
    """Refuse responses on the wrong side; warn of a bias, and of responses at chance.

    In all, of each person and in each level of ``by``; not of a bias that the model has
    (``biased``).
    """
    who = name_of(choices)
    several = choices.alternatives > 2
    if not several:
        check_signs(choices.strength, choices.response)
    if choices.strength is None and not several:
        return
    above = _check_right(choices, who)
    for person in choices.people():
        _check_right(choices.where(choices.participant == person), person)
    every = choices.conditions[list(by)]
    for levels, part in every.groupby(list(by)) if by else [((), every)]:
        some = choices.where(np.isin(every.index, part.index))
        named = "".join(f", {name} {level}" for name, level in zip(by, levels, strict=True))
        _check_right(some, who + named)
        if several or choices.withheld is not None:  # who has not decided in time leans to waiting
            continue
        share, z = lean(some)
        if abs(z) > STANDARD_ERRORS and not biased:
            DataWarning.warn(
                f"{who}{named}: response {int(share > 0)} comes in {abs(share):.1%} of trials more "
                f"than if both sides were alike ({abs(z):.1f} standard errors). Without "
                "a start of a sequential test or a bias of a circuit (free='+start' or "
                "'+bias_nats', at the terminal --free +start or +bias_nats) "
                f"models have no such bias: it affects the other parameters{_coded(some, share)}"
            )
    _warn_of_no_error(choices, who)
    if several and above <= CHANCE:
        DataWarning.warn(
            f"{who}: responses are correct no more often than by chance "
            f"({np.nanmean(choices.correct):.0%}, {above:.1f} standard errors)"
        )
    elif above <= CHANCE and np.isfinite(choices.correct).sum() >= ENOUGH:
        DataWarning.warn(
            f"{who}: responses agree with the sign of the strength no more often than by chance "
            f"({np.nanmean(choices.correct):.0%}, {above:.1f} standard errors): check that it is "
            "the column of the strength, that its rows belong to those of the responses, and that "
            "responses give the side if the strength has a sign"
        )


def _warn_of_no_error(choices: Trials, who: str) -> None:
    strength, right = choices.strength, choices.correct[np.isfinite(choices.correct)]
    if strength is None or not ((strength < 0).any() and (strength > 0).any()):
        return
    if len(right) >= ENOUGH and right.all():
        DataWarning.warn(
            f"{who}: each of {len(right)} responses agrees with the sign of its strength. If the "
            "strengths were given the sign of the responses, errors count as correct: give "
            "strengths without a sign, and code responses as 1 if correct and 0 if wrong "
            "(response, at the terminal --columns response=)"
        )


def _coded(choices: Trials, share: float) -> str:
    strength = np.zeros(choices.trials) if choices.strength is None else choices.strength
    against = choices.response[(choices.response >= 0) & (strength * share < 0)]
    same = float((against == int(share > 0)).mean()) if len(against) else 0.0
    if same <= SAME:
        return ""
    return (
        f". It is also that of {same:.0%} of trials whose strength favours the other one: "
        "if responses mean correct (1) and wrong (0), give strengths without a sign"
    )


def _check_right(choices: Trials, who: str) -> float:
    """Return by how many standard errors responses are right above chance; refuse far fewer."""
    right = choices.correct[np.isfinite(choices.correct)]
    count, trials = int(right.sum()), len(right)
    chance = 1 / choices.alternatives
    z = (count - trials * chance) / np.sqrt(max(trials, 1) * chance * (1 - chance))
    if z < -STANDARD_ERRORS and choices.alternatives > 2:
        raise InputError(
            f"{who}: responses must be correct more often than by chance ({chance:.0%}), got "
            f"{count} of {trials} ({-z:.1f} standard errors below it): check which column holds "
            "the correct alternative (stimulus), and the number of alternatives",
            "response",
        )
    if z < -STANDARD_ERRORS:
        raise InputError(
            f"{who}: responses must agree with the sign of the strength more often than not, "
            f"got {count} of {trials} ({count / trials:.0%}, {-z:.1f} standard errors below "
            "chance): name the other response as the one that counts as 1 (upper, at the terminal "
            "--columns upper=), or change the sign of the strengths",
            "response",
        )
    return float(z)


def lean(choices: Trials) -> tuple[float, float]:
    """Return the bias to response 1, as a share of all responses, and its z score.

    The excess of response 1 over that of models that are the same for both sides; z is given the
    number of correct responses at each strength (Cochran 1954; Mantel & Haenszel 1959).
    """
    if choices.strength is None:
        return 0.0, 0.0
    answered = choices.response >= 0
    strength, ones = choices.strength[answered], choices.response[answered] == 1
    beyond, variance = 0.0, 0.0
    for size in np.unique(np.abs(strength)):
        positive, negative = ones[strength == size], ones[strength == -size]
        if size == 0:
            beyond += positive.sum() - positive.size / 2
            variance += positive.size / 4
            continue
        trials, right = positive.size + negative.size, positive.sum() + (~negative).sum()
        # Excess of correct responses on one side; the same number is missing on the other.
        beyond += 2 * (positive.sum() - positive.size * right / trials)
        spread = positive.size * negative.size * right * (trials - right)
        variance += 4 * spread / (trials**2 * max(trials - 1, 1))
    if not variance:
        return 0.0, 0.0
    return float(beyond / len(ones)), float(beyond / np.sqrt(variance))
