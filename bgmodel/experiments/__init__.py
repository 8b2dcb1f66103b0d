"""A hypothesis as a file: what is edited, what is measured, what was predicted."""
