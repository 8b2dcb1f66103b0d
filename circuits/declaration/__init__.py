"""The declaration of a circuit: rows, courses, edits and files."""
