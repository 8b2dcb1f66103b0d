"""Input and output tables: trials, evidence, exports."""
