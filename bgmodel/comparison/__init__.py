"""A circuit held against the abstract test, decision by decision."""
