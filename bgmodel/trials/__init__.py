"""Trials of people, animals and models: one record, one reader, one set of guards."""
