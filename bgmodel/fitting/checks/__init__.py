"""Where a fitted model fails: data that differ from it, slow trials, and what a fit warns of."""
