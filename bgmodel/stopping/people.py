"""Stop-signal trials of people, and the estimates of each of them."""

from __future__ import annotations

from pathlib import Path

import pandas as pd

from bgmodel.stopping.estimates import estimate_ssrt
from bgmodel.stopping.trials import StopTrials
from bgmodel.tables.shipped import STOP_SET
from bgmodel.trials.reading import OURS, Columns, read_trials
from circuits.errors import DataWarning, InputError, collected, within

SHIPPED = STOP_SET
"""126 healthy adults, UCLA Consortium for Neuropsychiatric Phenomics (Poldrack et al. 2016)."""


def read_people(
    source: pd.DataFrame | str | Path = SHIPPED, *, columns: Columns = OURS
) -> dict[str, StopTrials]:
    """Return the stop-signal trials of each participant, read by ``read_trials``.

    Raises
    ------
    ValueError
        As for ``read_trials``, without delays, and for the impossible trials of a participant.
    """
    people = {}
    for who, trials in read_trials(source, columns=columns).by_participant().items():
        try:
            people[who] = StopTrials.of(trials)
        except InputError as error:
            raise within(f"participant {who}", error, "source") from None
    return people


def estimates_of(people: dict[str, StopTrials]) -> pd.DataFrame:
    """Return the estimates of every participant, one row each.

    Columns participant_id and the fields of ``StopEstimate``; ``refusal`` says why the guide
    accepts no estimate of a participant. It is "no responses on go trials" or "no stop trials"
    where no estimate can be computed.

    Warns
    -----
    UserWarning
        Once, if participants have fewer stop trials than the guide asks for.
    """
    rows, few = [], 0
    for who, trials in people.items():
        with collected(DataWarning) as caught:
            try:
                row = vars(estimate_ssrt(trials, checked=False))
            except InputError as error:
                kind = "no responses on go trials" if error.field == "rt_ms" else "no stop trials"
                row = {"refusal": kind}
        few += bool(caught)
        rows.append({"participant_id": who, **row})
    if few:
        share = f"{few} of {len(people)} participants have too few stop trials"
        DataWarning.warn(f"{share}: their estimates are unreliable, their mean is less so")
    return pd.DataFrame(rows)
