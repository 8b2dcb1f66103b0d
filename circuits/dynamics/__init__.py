"""From a table to the arrays that every engine integrates, and its fixed point."""
