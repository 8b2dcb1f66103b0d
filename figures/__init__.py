"""One script per figure: each computes a tidy table and then draws it."""
