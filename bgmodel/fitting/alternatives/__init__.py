"""Models of choices between more than two alternatives: optimal test, race, LCA and circuits.

By symmetry a response is correct or wrong: which of the wrong ones it is says nothing, since they
are equally likely.
"""
