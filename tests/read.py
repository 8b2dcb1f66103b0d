"""Reading with names, units and codes of columns among the options."""

from dataclasses import fields

from bgmodel.trials.reading import Columns, read_trials

OWN = tuple(each.name for each in fields(Columns))


def read(source, **options):
    """Return the trials of a table; options that ``Columns`` has are given as such."""
    columns = Columns(**{name: options.pop(name) for name in OWN if name in options})
    return read_trials(source, columns=columns, **options)
