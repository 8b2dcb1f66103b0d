"""Reading with names, units and codes of columns among the options, and changes of tables."""

from dataclasses import fields

from bgmodel.trials.reader import Columns, read_trials

OWN = tuple(each.name for each in fields(Columns))


def read(source, **options):
    """Return the trials of a table; options that ``Columns`` has are given as such."""
    columns = Columns(**{name: options.pop(name) for name in OWN if name in options})
    return read_trials(source, columns=columns, **options)


def changed(**columns):
    return lambda good: good.assign(**columns)


def at(name, row, value):
    """Return what puts a value into one row of a column."""
    return changed(**{name: lambda t: t[name].astype(object).where(t.index != row, value)})


def without(column):
    return lambda good: good.drop(columns=column)


def renamed(**columns):
    return lambda good: good.rename(columns=columns)
