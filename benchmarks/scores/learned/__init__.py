"""Parts of the scores of learned weights."""
