"""Speed compared with the alternatives that a user might choose."""
