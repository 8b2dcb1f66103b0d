"""Hypotheses as files: the manipulation, the measures and the predictions."""
