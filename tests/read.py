"""Tables of trials, changes of them, and reading with names, units and codes of columns."""

from dataclasses import fields

import numpy as np
import pandas as pd

from bgmodel.trials.reader import Columns, read_trials

OWN = tuple(each.name for each in fields(Columns))
ROWS = 48


def read(source, **options):
    """Return the trials of a table; options that ``Columns`` has are given as such."""
    columns = Columns(**{name: options.pop(name) for name in OWN if name in options})
    return read_trials(source, columns=columns, **options)


def table_of(kind, **changes):
    """Return the trials of two people, half of the rows each."""
    rng = np.random.default_rng(2)
    columns = {
        "choices": {"coherence": [-0.3, 0.3, 0.1], "response": [0, 1, 1, 0]},
        "stop signals": {"ssd": [np.nan, np.nan, 0.2]},
        "pairs": {"pair": ["AB", "CD"], "response": [1, 0, 1, 1, 0, 1, 1, 1],
                  "reward": [1, 0, 1, 1, 0, 1, 0, 1]},
    }  # fmt: skip
    more = {name: np.resize(values, ROWS) for name, values in columns[kind].items()}
    rt = np.round(rng.uniform(0.35, 0.9, ROWS), 4)
    who = np.repeat(["a", "b"], ROWS // 2)
    return pd.DataFrame({"participant_id": who, "rt": rt, **more}).assign(**changes)


def silent(table, rows, **more):
    """Return the table without the responses of some rows."""
    chosen = table.index.isin(rows)
    response = table["response"].astype(object).where(~chosen, None)
    return table.assign(rt=table["rt"].where(~chosen), response=response, **more)


def written(table, path):
    """Return the path of a file that holds a table, in the form that its ending says."""
    if path.suffix == ".parquet":
        table.to_parquet(path)
    else:
        table.to_csv(path, index=False, sep="\t" if path.suffix == ".tsv" else ",")
    return path


def changed(**columns):
    return lambda good: good.assign(**columns)


def at(name, row, value):
    """Return what puts a value into one row of a column."""
    return changed(**{name: lambda t: t[name].astype(object).where(t.index != row, value)})


def without(column):
    return lambda good: good.drop(columns=column)


def renamed(**columns):
    return lambda good: good.rename(columns=columns)
