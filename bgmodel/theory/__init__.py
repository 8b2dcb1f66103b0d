"""Theory of the sequential test: closed forms, first passages, exact recursions."""
