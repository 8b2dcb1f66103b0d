"""From a table to the numbers that every engine integrates, and its fixed point."""
