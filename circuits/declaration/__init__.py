"""A circuit as it is written: rows, courses, edits of rows, and files."""
