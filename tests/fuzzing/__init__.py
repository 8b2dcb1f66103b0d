"""Random inputs, valid and broken, as a new user would type, edit and write them.

Each kind of input has a generator: ``make(rng, folder)`` returns a ``Case``. A broken one is a
valid one with exactly one thing made wrong, so that it is known whether it must be refused.
"""
